// A dome light's map and sampling tables in GLSL: see lookdev/light/dome and lookdev/shaders/dome.osl.h.

// (x, y) are in [0, 1]: x along a row, y from the top.
vec2 dome_place(vec3 w) {
    return vec2(0.5 - look_atan2(w.y, w.x) / 6.283185307179586, look_atan2(length(w.xy), w.z) / 3.141592653589793);
}

// Bilinear, periodic around, clamped at the poles.
vec3 dome_look_up(highp sampler2D map, vec3 w) {
    ivec2 size = textureSize(map, 0);
    vec2 place = dome_place(w) * vec2(size) - 0.5;
    place.y = clamp(place.y, 0.0, float(size.y - 1));
    vec2 corner = floor(place), s = place - corner;
    int left = int(corner.x), top = int(corner.y);
    left = left < 0 ? left + size.x : left >= size.x ? left - size.x : left;
    int right = left + 1 < size.x ? left + 1 : 0, bottom = min(top + 1, size.y - 1);
    vec3 above = mix(texelFetch(map, ivec2(left, top), 0).rgb, texelFetch(map, ivec2(right, top), 0).rgb, s.x);
    vec3 below = mix(texelFetch(map, ivec2(left, bottom), 0).rgb, texelFetch(map, ivec2(right, bottom), 0).rgb, s.x);
    return mix(above, below, s.y);
}

// The bin of a normal (lookdev/light/dome/bins.py), and its axis.
int dome_bin(vec3 n, out vec3 axis) {
    float down = look_atan2(length(n.xy), n.z) / 3.141592653589793;
    int row = clamp(int(down * float(DOME_ROWS)), 0, DOME_ROWS - 1);
    float around = look_atan2(n.y, n.x) / 6.283185307179586;
    int cell = clamp(int((around - floor(around)) * float(dome_cells[row])), 0, dome_cells[row] - 1);
    vec2 azimuth = look_turn(6.283185307179586 * (float(cell) + 0.5) / float(dome_cells[row]));
    vec2 theta = look_turn(3.141592653589793 * (float(row) + 0.5) / float(DOME_ROWS));
    axis = vec3(theta.x * azimuth.y, theta.x * azimuth.x, theta.y);
    return dome_first[row] + cell;
}

// The widened cosine of a bin: the largest between a direction and its normals, from the cosine to its axis.
float dome_widened(float cosine) {
    float turned = DOME_COS_RADIUS * cosine + DOME_SIN_RADIUS * sqrt(max(1.0 - cosine * cosine, 0.0));
    return cosine > DOME_COS_RADIUS ? 1.0 : max(turned, 0.0);
}

// A slot of a bin by u1, one of its points by u2: a direction and its radiance; `share` is M / sum(g) of the bin, and
// `ratio` times the widened cosine is q / p, the pdf over the probability (lookdev/light/dome/slots.py).
vec3 dome_sample(highp isampler2D slots, highp sampler2D points, int bin, float share, float u1, float u2,
                 out vec3 w, out float ratio) {
    int slot = texelFetch(slots, ivec2(clamp(int(u1 * float(DOME_SLOTS)), 0, DOME_SLOTS - 1), bin), 0).r;
    int code = slot & ((1 << DOME_CODE_BITS) - 1);
    // A count of points, or the number of slots that a single point fills.
    int count = code > DOME_MOST_POINTS ? 1 : code;
    int times = code > DOME_MOST_POINTS ? code - DOME_MOST_POINTS + 1 : 1;
    ratio = share * float(count) / float(times);
    int place = ((slot >> DOME_CODE_BITS) & 0xfffff) + clamp(int(float(count) * u2), 0, max(count - 1, 0));
    vec4 cell = texelFetch(points, ivec2(place & 1023, place >> 10), 0);
    vec2 azimuth = look_turn(cell.x);
    w = vec3(sqrt(max(1.0 - cell.y * cell.y, 0.0)) * azimuth.yx, cell.y);
    float red = floor(cell.w / 4096.0), green = cell.w - 4096.0 * red;
    return 3.0 * cell.z / 4095.0 * vec3(red, green, max(4095.0 - red - green, 0.0));
}
