// A textured rectangle by quadrants of quadrants (lookdev/light/picture.py), as lookdev/shaders/rig.h has it; `tree` is the
// place of their means in the rig's tables.

float picture_cell(int light, int tree, int side, int row, int column, vec3 p) {
    float angle, size = 1.0 / float(side);
    picture_angle(light, p, size * float(column), size * float(row), size, angle);
    // The levels before have 4 + 16 + ... cells.
    return angle * look_up(rig_tables, float(tree + (side * side - 4) / 3 + row * side + column));
}

// The weights of the quadrants of a cell: low, low right, high, high right.
vec4 picture_quadrants(int light, int tree, int side, int row, int column, vec3 p) {
    vec4 weights;
    for (int k = 0; k < 4; ++k) weights[k] = picture_cell(light, tree, side, row + (k >> 1), column + (k & 1), p);
    return weights;
}

void picture_draw(int light, vec3 p, float u1, float u2, out vec3 w, out float distance, out float pdf) {
    int tree = int(rig_field(light, LAMP_tree)), row = 0, column = 0, side = 1;
    float share = 1.0;
    for (int level = 0; level < PICTURE_LEVELS; ++level) {
        side *= 2;
        row *= 2;
        column *= 2;
        vec4 q = picture_quadrants(light, tree, side, row, column, p);
        float sum = max(q.x + q.y + q.z + q.w, 1e-30), left = (q.x + q.z) / sum;
        bool right = u1 >= left;
        u1 = clamp(right ? (u1 - left) / (1.0 - left) : u1 / left, 0.0, 0.99999994);
        vec2 chosen = right ? q.yw : q.xz;
        float lower = chosen.x / max(chosen.x + chosen.y, 1e-30);
        bool upper = u2 >= lower;
        u2 = clamp(upper ? (u2 - lower) / (1.0 - lower) : u2 / lower, 0.0, 0.99999994);
        column += right ? 1 : 0;
        row += upper ? 1 : 0;
        share *= (upper ? chosen.y : chosen.x) / sum;
    }
    float size = 1.0 / float(side);
    picture_part(light, p, size * float(column), size * float(row), size, u1, u2, w, distance, pdf);
    pdf *= share;
}

void picture_meet(int light, vec3 p, vec3 w, out float distance, out float pdf) {
    float s, t;
    picture_place(light, p, w, distance, s, t);
    pdf = 0.0;
    if (distance >= RIG_FAR) return;
    const int cells = 1 << PICTURE_LEVELS;
    int tree = int(rig_field(light, LAMP_tree));
    int row = clamp(int(t * float(cells)), 0, cells - 1), column = clamp(int(s * float(cells)), 0, cells - 1);
    float share = 1.0, size = 1.0 / float(cells);
    for (int level = 1; level <= PICTURE_LEVELS; ++level) {
        int down = PICTURE_LEVELS - level, i = row >> down, j = column >> down;
        vec4 q = picture_quadrants(light, tree, 1 << level, i & ~1, j & ~1, p);
        share *= q[2 * (i & 1) + (j & 1)] / max(q.x + q.y + q.z + q.w, 1e-30);
    }
    picture_density(light, p, w, size * float(column), size * float(row), size, pdf);
    pdf *= share;
}

// Bilinear and clamped, from its first column and its first row on.
vec3 picture_look_up(highp sampler2D picture, vec2 place) {
    ivec2 last = textureSize(picture, 0) - 1;
    place = place * vec2(last + 1) - 0.5;
    vec2 corner = floor(place), share = place - corner;
    ivec2 low = clamp(ivec2(corner), ivec2(0), last), high = clamp(ivec2(corner) + 1, ivec2(0), last);
    vec3 upper = mix(texelFetch(picture, low, 0).rgb, texelFetch(picture, ivec2(high.x, low.y), 0).rgb, share.x);
    vec3 lower = mix(texelFetch(picture, ivec2(low.x, high.y), 0).rgb, texelFetch(picture, high, 0).rgb, share.x);
    return mix(upper, lower, share.y);
}
//@ textures

void picture_sent(int light, vec3 p, vec3 w, out vec3 sent) {
    float distance, s, t;
    picture_untextured(light, p, w, sent);
    picture_place(light, p, w, distance, s, t);
    sent *= picture_texel(int(rig_field(light, LAMP_picture)), vec2(1.0 - s, 1.0 - t));
}
