// The light: an equirectangular map with its sampling tables, as `lookdev/light/tables.py` lays them out.
// (x, y) are in [0, 1]: x along a row, y from the top; `turn` rotates the map about z, in radians.

// lookdev/light/mapping.py, direction_to_uv with v = 1 - y. atan2 keeps its precision at the poles, acos would not.
void light_from_direction(vector w, float turn, output float x, output float y)
{
    x = 0.5 - (atan2(w[1], w[0]) - turn) / M_2PI;
    y = atan2(hypot(w[0], w[1]), w[2]) / M_PI;
}

color light_radiance_at(string file, float x, float y)
{
    float alpha;
    float inset = 0.5 / LIGHT_HEIGHT;
    float row = clamp(y, inset, 1 - inset);
#if LOOKDEV_ROW_0_AT_T_1
    float place = x - floor(x);
    color radiance = lookdev_black(file, place, row, alpha);
    if (min(place, 1 - place) * LIGHT_WIDTH < 0.5)
        radiance += lookdev_black(file, place < 0.5 ? place + 1 : place - 1, row, alpha);
#else
    color radiance = texture(file, x, IMAGE_T(row), 0, 0, 0, 0,
                             "swrap", "periodic", "twrap", "clamp", "interp", "linear");
#endif
    return radiance;
}

#if IBL_SAMPLES > 0
// The bin of a normal (lookdev/light/bins.py), and its axis.
int light_bin(vector n, float turn, output vector axis)
{
    int cells[LIGHT_ROWS] = LIGHT_CELLS;
    int first[LIGHT_ROWS] = LIGHT_FIRST;
    // An index beyond its array ends the renderer, and a unit vector may be rounded to more than 1.
    int row = clamp(int(acos(clamp(n[2], -1, 1)) * (LIGHT_ROWS / M_PI)), 0, LIGHT_ROWS - 1);
    float around = (atan2(n[1], n[0]) - turn) / M_2PI;
    int cell = clamp(int((around - floor(around)) * cells[row]), 0, cells[row] - 1);
    float azimuth = M_2PI * (cell + 0.5) / cells[row] + turn;
    float theta = M_PI * (row + 0.5) / LIGHT_ROWS;
    float s;
    float c;
    sincos(azimuth, s, c);
    axis = vector(sin(theta) * c, sin(theta) * s, cos(theta));
    return first[row] + cell;
}

// The largest cosine between a direction and the normals of a bin, from that to its axis.
float light_widened(float cosine)
{
    float turned = LIGHT_COS_RADIUS * cosine + LIGHT_SIN_RADIUS * sqrt(max(1 - cosine * cosine, 0));
    return cosine > LIGHT_COS_RADIUS ? 1 : max(turned, 0);
}

// Sample `number` of a bin: a direction and the radiance from there; `ratio` times the widened cosine is q / p.
color light_sample(int slots[], float bins[], string points, int bin, int number, int seed, float turn,
                   output vector wi, output float ratio)
{
    // Bits reversed: numbers that follow each other are far apart on the curve.
    int slot = slots[bin * LIGHT_SLOTS + ((sobol_reverse(number) >> LIGHT_SLOTS_SHIFT) & (LIGHT_SLOTS - 1))];
    int code = slot & ((1 << LIGHT_CODE_BITS) - 1);
    if (code == 0) {
        ratio = 0;
        return 0;
    }
    // A count of points, or how many slots a single one fills.
    int count = code > LIGHT_MOST_POINTS ? 1 : code;
    int times = code > LIGHT_MOST_POINTS ? code - LIGHT_MOST_POINTS + 1 : 1;
    ratio = bins[2 * bin + 1] * count / times;
    float u = sobol_unit(sobol_hash(seed ^ (number * 0x2c1b3c6d + 0x297a2d39)));
    int place = ((slot >> LIGHT_CODE_BITS) & 0xfffff) + min(int(count * u), count - 1);
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
