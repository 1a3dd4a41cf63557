// Texture look-ups that are alike on every Blender. The worker defines LOOKDEV_ROW_0_AT_T_1: 4.5 evaluates texture()
// by OpenImageIO, whose t = 0 is the top row of a file; 5.x has t = 0 at the bottom, is always bilinear and, whatever
// "wrap" is, black outside. Derivatives of zero with "interp" "linear" give plain bilinear look-ups on both.

#if LOOKDEV_ROW_0_AT_T_1
#define IMAGE_T(y) (1.0 - (y))
#else
#define IMAGE_T(y) (y)
#endif

// The texel (i, j) of a float table, row 0 at the top; callers round values that may be interpolated.
color lookdev_texel(string file, float i, float j, float width, float height)
{
    color value = texture(file, (i + 0.5) / width, IMAGE_T((j + 0.5) / height), 0, 0, 0, 0,
                          "wrap", "clamp", "interp", "closest");
    return value;
}

#if LOOKDEV_ROW_0_AT_T_1
// Bilinear weights are tents about texel centres: an image that repeats or mirrors is the sum of its copies, of which
// at most two overlap. Returns the coordinate in the image, and in `other` that in the nearest copy.
float lookdev_wrap(float s, string wrap, output float other)
{
    if (wrap == "black") {
        other = -2;
        return s;
    }
    if (wrap == "periodic") {
        float place = s - floor(s);
        other = place < 0.5 ? place + 1 : place - 1;
        return place;
    }
    // Within half a texel of an edge, clamped and mirrored are the same.
    float place = wrap == "mirror" ? fabs(s - 2 * floor(0.5 * s + 0.5)) : clamp(s, 0, 1);
    other = place < 0.5 ? -place : 2 - place;
    return place;
}

// One look-up, black outside, y from the top.
color lookdev_black(string file, float s, float y, output float alpha)
{
    color value = texture(file, s, IMAGE_T(y), 0, 0, 0, 0, "alpha", alpha);
    return value;
}
#endif

// A texture at st, (0, 0) its lower left corner.
color lookdev_texture(string file, float s, float t, string wrap_s, string wrap_t, output float alpha)
{
#if LOOKDEV_ROW_0_AT_T_1
    float s1;
    float y1;
    float s0 = lookdev_wrap(s, wrap_s, s1);
    float y0 = lookdev_wrap(1.0 - t, wrap_t, y1);
    float a;
    float b;
    float c;
    color value = lookdev_black(file, s0, y0, alpha);
    value += lookdev_black(file, s1, y0, a);
    value += lookdev_black(file, s0, y1, b);
    value += lookdev_black(file, s1, y1, c);
    alpha += a + b + c;
#else
    color value = texture(file, s, IMAGE_T(1.0 - t), 0, 0, 0, 0,
                          "swrap", wrap_s, "twrap", wrap_t, "interp", "linear", "alpha", alpha);
#endif
    return value;
}

// The derivative of an axis' wrapping: -1 in mirrored copies, 0 beyond a clamped edge.
float lookdev_wrap_slope(float s, string wrap)
{
    if (wrap == "mirror")
        return mod(floor(s), 2.0) == 1.0 ? -1.0 : 1.0;
    return wrap == "clamp" && (s < 0 || s > 1) ? 0.0 : 1.0;
}

// The slopes of a height map along s and t at st.
color lookdev_slopes(string file, float s, float t, string wrap_s, string wrap_t, output float alpha)
{
    color value = lookdev_texture(file, s, t, wrap_s, wrap_t, alpha);
    return color(value[0] * lookdev_wrap_slope(s, wrap_s), value[1] * lookdev_wrap_slope(t, wrap_t), 0);
}
