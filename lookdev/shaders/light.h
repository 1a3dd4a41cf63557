// The light: an equirectangular map with its sampling tables, as `lookdev/ibl/tables.py` lays them out.
// (x, y) are in [0, 1]: x along a row, y from the top; `turn` rotates the map about z, in radians.

// lookdev/ibl/mapping.py, direction_to_uv with v = 1 - y. atan2 keeps its precision at the poles, acos would not.
void light_from_direction(vector w, float turn, output float x, output float y)
{
    x = 0.5 - (atan2(w[1], w[0]) - turn) / M_2PI;
    y = atan2(hypot(w[0], w[1]), w[2]) / M_PI;
}

// From the nearer pole, as float32 has no pi; and OSL's sin() is good to 6e-8 only, however small the angle.
float light_cos_latitude(float y)
{
    float angle = M_PI * min(y, 1 - y);
    return angle < 0.1 ? angle * (1 - angle * angle / 6) : sin(angle);
}

vector light_direction(float x, float y, float turn)
{
    float azimuth = M_PI * (1 - 2 * x) + turn;
    float s;
    float c;
    sincos(azimuth, s, c);
    float horizontal = light_cos_latitude(y);
    return vector(c * horizontal, s * horizontal, cos(M_PI * y));
}

// The triangular density on [-1, 1], by inversion.
float light_tent(float u)
{
    return u < 0.5 ? sqrt(2 * u) - 1 : 1 - sqrt(2 - 2 * u);
}

// Entry `number` of the table: its texel, and a place in it by the bilinear footprint.
void light_sample(string file, int number, int seed, output float x, output float y)
{
    int entry = number & (LIGHT_ENTRIES - 1);
    color texel = lookdev_texel(file, entry & 1023, (entry >> 10) & 0x3fffff, 1024, LIGHT_ENTRIES / 1024);
    int random = sobol_hash(seed ^ (number * 0x2c1b3c6d + 0x297a2d39));
    float j = floor(texel[1] + 0.5) + 0.5 + light_tent(sobol_unit(sobol_hash(random + 0x5bd1e995)));
    x = (floor(texel[0] + 0.5) + 0.5 + light_tent(sobol_unit(random))) / LIGHT_WIDTH;
    // At a pole the footprint folds back, which is what a clamped look-up integrates to.
    y = j / LIGHT_HEIGHT;
    y = y < 0 ? -y : (y > 1 ? 2 - y : y);
}

// Radiance, and the density of light_sample() over solid angle.
color light_radiance_at(string file, float x, float y, output float pdf)
{
    float inset = 0.5 / LIGHT_HEIGHT;
    float row = clamp(y, inset, 1 - inset);
#if LOOKDEV_ROW_0_AT_T_1
    float place = x - floor(x);
    color radiance = lookdev_black(file, place, row, pdf);
    if (min(place, 1 - place) * LIGHT_WIDTH < 0.5) {
        float rest;
        radiance += lookdev_black(file, place < 0.5 ? place + 1 : place - 1, row, rest);
        pdf += rest;
    }
#else
    color radiance = texture(file, x, IMAGE_T(row), 0, 0, 0, 0,
                             "swrap", "periodic", "twrap", "clamp", "interp", "linear", "alpha", pdf);
#endif
    pdf /= 2 * M_PI * M_PI * max(light_cos_latitude(y), 1e-9);
    return radiance;
}
