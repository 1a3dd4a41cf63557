// Texture look-ups that mean the same on every Blender. The worker defines LOOKDEV_ROW_0_AT_T_1:
// 4.5 hands texture() to OpenImageIO, whose t = 0 is the top row of a file; 5.x looks images up itself, t = 0 at
// the bottom, always bilinear. Derivatives of zero and "interp" "linear" ask both for plain bilinear look-ups.

#if LOOKDEV_ROW_0_AT_T_1
#define IMAGE_T(y) (1.0 - (y))
#else
#define IMAGE_T(y) (y)
#endif

// The texel (i, j) of a float table, row 0 at the top; callers round what may come back interpolated.
color lookdev_texel(string file, float i, float j, float width, float height)
{
    color value = texture(file, (i + 0.5) / width, IMAGE_T((j + 0.5) / height), 0, 0, 0, 0,
                          "wrap", "clamp", "interp", "closest");
    return value;
}

// A texture at st, (0, 0) its lower left corner.
color lookdev_texture(string file, float s, float t, string wrap_s, string wrap_t, output float alpha)
{
    color value = texture(file, s, IMAGE_T(1.0 - t), 0, 0, 0, 0,
                          "swrap", wrap_s, "twrap", wrap_t, "interp", "linear", "alpha", alpha);
    return value;
}
