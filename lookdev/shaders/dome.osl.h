// A dome light: an equirectangular map and its sampling tables, as lookdev/light/dome writes them.

//@ section parameters
    string dome_radiance = "",
#if IBL_SAMPLES > 0
    string dome_points = "",
    // The worker writes the light's tables over these values.
    int dome_slots[DOME_ALL_SLOTS] = {0},
    float dome_bins[DOME_BIN_NUMBERS] = {0},
#endif
//@ section functions
// (x, y) are in [0, 1]: x along a row, y from the top. As direction_to_uv of lookdev/light/mapping.py, with v = 1 - y;
// atan2 keeps its precision at the poles, where acos loses it.
void dome_place(vector w, float turn, output float x, output float y)
{
    x = 0.5 - (atan2(w[1], w[0]) - turn) / M_2PI;
    y = atan2(hypot(w[0], w[1]), w[2]) / M_PI;
}

color dome_look_up(string file, float x, float y, int width, int height)
{
    float alpha;
    float inset = 0.5 / height;
    float row = clamp(y, inset, 1 - inset);
#if LOOKDEV_ROW_0_AT_T_1
    float place = x - floor(x);
    color radiance = lookdev_black(file, place, row, alpha);
    if (min(place, 1 - place) * width < 0.5)
        radiance += lookdev_black(file, place < 0.5 ? place + 1 : place - 1, row, alpha);
#else
    color radiance = texture(file, x, IMAGE_T(row), 0, 0, 0, 0,
                             "swrap", "periodic", "twrap", "clamp", "interp", "linear");
#endif
    return radiance;
}

#if IBL_SAMPLES > 0
// The bin of a normal (lookdev/light/dome/bins.py), and its axis.
int dome_bin(vector n, float turn, output vector axis)
{
    int cells[DOME_ROWS] = DOME_CELLS;
    int first[DOME_ROWS] = DOME_FIRST;
    // An index beyond its array crashes the renderer, and rounding makes components of unit vectors greater than 1.
    int row = clamp(int(acos(clamp(n[2], -1, 1)) * (DOME_ROWS / M_PI)), 0, DOME_ROWS - 1);
    float around = (atan2(n[1], n[0]) - turn) / M_2PI;
    int cell = clamp(int((around - floor(around)) * cells[row]), 0, cells[row] - 1);
    float azimuth = M_2PI * (cell + 0.5) / cells[row] + turn;
    float theta = M_PI * (row + 0.5) / DOME_ROWS;
    float s;
    float c;
    sincos(azimuth, s, c);
    axis = vector(sin(theta) * c, sin(theta) * s, cos(theta));
    return first[row] + cell;
}

// The widened cosine of a bin: the largest between a direction and its normals, from the cosine to its axis.
float dome_widened(float cosine)
{
    float turned = DOME_COS_RADIUS * cosine + DOME_SIN_RADIUS * sqrt(max(1 - cosine * cosine, 0));
    return cosine > DOME_COS_RADIUS ? 1 : max(turned, 0);
}

int dome_slot(float u)
{
    return clamp(int(u * DOME_SLOTS), 0, DOME_SLOTS - 1);
}

// The slot of sample `number`, and a number in [0, 1) for its point. Reversed bits: consecutive numbers are far apart on
// the curve of the points.
int dome_numbered(int number, int seed, output float u)
{
    u = sobol_unit(sobol_hash(seed ^ (number * 0x2c1b3c6d + 0x297a2d39)));
    return (sobol_reverse(number) >> DOME_SLOTS_SHIFT) & (DOME_SLOTS - 1);
}

// Slot `number` of a bin, and by u one of its points: a direction and its radiance; `ratio` times the widened cosine is
// q / p, the pdf over the probability (lookdev/light/dome/slots.py).
color dome_sample(int slots[], float bins[], string points, int bin, int number, float u, float turn,
                  output vector wi, output float ratio)
{
    int slot = slots[bin * DOME_SLOTS + number];
    int code = slot & ((1 << DOME_CODE_BITS) - 1);
    if (code == 0) {
        ratio = 0;
        return 0;
    }
    // A count of points, or the number of slots that a single point fills.
    int count = code > DOME_MOST_POINTS ? 1 : code;
    int times = code > DOME_MOST_POINTS ? code - DOME_MOST_POINTS + 1 : 1;
    ratio = bins[2 * bin + 1] * count / times;
    int place = ((slot >> DOME_CODE_BITS) & 0xfffff) + min(int(count * u), count - 1);
    float color_code;
    color cell = texture(points, ((place & 1023) + 0.5) / 1024, IMAGE_T(((place >> 10) + 0.5) / 1024), 0, 0, 0, 0,
                         "wrap", "clamp", "interp", "closest", "alpha", color_code);
    float s;
    float c;
    sincos(cell[0] + turn, s, c);
    float horizontal = sqrt(max(1 - cell[1] * cell[1], 0));
    wi = vector(horizontal * c, horizontal * s, cell[1]);
    float red = floor(color_code / 4096.0);
    float green = color_code - 4096.0 * red;
    return 3 * cell[2] / 4095.0 * color(red, green, max(4095.0 - red - green, 0));
}
#endif
//@ section setup
    // The first slot of this pixel. Exclusive or with a random number keeps aligned blocks of numbers aligned, hence
    // stratified, and makes every slot equally likely.
    int start = sobol_hash(seed ^ 0x2545f491);
    vector axis;
    int bin = dome_bin(n, turn, axis);
    float scale = dome_bins[2 * bin];
#if TRANSMITS
    vector back_axis;
    int back_bin = dome_bin(-n, turn, back_axis);
    float back_scale = dome_bins[2 * back_bin];
#endif
//@ section sample
            float u;
            int slot = dome_numbered(start ^ number, seed + back, u);
#if TRANSMITS
            radiance = dome_sample(dome_slots, dome_bins, dome_points, back ? back_bin : bin, slot, u, turn, wi, ratio);
            ratio *= dome_widened(dot(wi, back ? back_axis : axis));
#else
            radiance = dome_sample(dome_slots, dome_bins, dome_points, bin, slot, u, turn, wi, ratio);
            ratio *= dome_widened(dot(wi, axis));
#endif
//@ section density
        float weighed = front_samples * scale * dome_widened(dot(wi, axis));
#if TRANSMITS
        weighed += back_samples * back_scale * dome_widened(dot(wi, back_axis));
#endif
        density += weighed * (radiance[0] + radiance[1] + radiance[2]) / 3;
//@ section lookup
            float map_x;
            float map_y;
            dome_place(wi, turn, map_x, map_y);
            radiance = dome_look_up(dome_radiance, map_x, map_y, DOME_WIDTH, DOME_HEIGHT);
