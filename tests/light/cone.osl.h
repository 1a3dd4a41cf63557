// A cone of directions, all of the same radiance.

//@ section parameters
//@ section functions
vector cone_axis(float turn)
{
    float s;
    float c;
    sincos(turn, s, c);
    return vector(c * CONE_X - s * CONE_Y, s * CONE_X + c * CONE_Y, CONE_Z);
}
//@ section setup
    vector cone = cone_axis(turn);
//@ section sample
            float u1;
            float u2;
            sobol_2d(number, sobol_hash(seed ^ (back + 0x51ed270b)), u1, u2);
            float cosine = 1 - u1 * (1 - CONE_COSINE);
            float s;
            float c;
            sincos(M_2PI * u2, s, c);
            vector across = normalize(cross(cone, vector(0, 0, 1)));
            wi = cosine * cone + sqrt(1 - cosine * cosine) * (c * across + s * cross(cone, across));
            radiance = CONE_RADIANCE;
//@ section density
        if (dot(wi, cone) > CONE_COSINE)
            density += (front_samples + back_samples) / (M_2PI * (1 - CONE_COSINE));
//@ section lookup
            radiance = dot(wi, cone_axis(turn)) > CONE_COSINE ? CONE_RADIANCE : 0;
