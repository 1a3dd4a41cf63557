// Several lights: lamps by rows of numbers (lookdev/light/lamps.py), domes by their tables. The functions of each shape
// are generated from lookdev/light. `at` is the place of a row in `lamps`.

#define FAR 1e30

// A vector, or a place from the axis, in the frame of the lights that have turned about z by an angle.
vector rig_back(vector v, float turn)
{
    float s;
    float c;
    sincos(turn, s, c);
    return vector(c * v[0] + s * v[1], c * v[1] - s * v[0], v[2]);
}

vector rig_forth(vector v, float turn)
{
    return rig_back(v, -turn);
}

vector lamp_position(float lamps[], int at)
{
    return vector(lamps[at + LAMP_x], lamps[at + LAMP_y], lamps[at + LAMP_z]);
}

// A vector of the rig by the axes of a lamp, and back.
vector lamp_inside(float lamps[], int at, vector v)
{
    int a = at + LAMP_x0;
    return vector(v[0] * lamps[a] + v[1] * lamps[a + 1] + v[2] * lamps[a + 2],
                  v[0] * lamps[a + 3] + v[1] * lamps[a + 4] + v[2] * lamps[a + 5],
                  v[0] * lamps[a + 6] + v[1] * lamps[a + 7] + v[2] * lamps[a + 8]);
}

vector lamp_outside(float lamps[], int at, vector v)
{
    int a = at + LAMP_x0;
    return v[0] * vector(lamps[a], lamps[a + 1], lamps[a + 2])
           + v[1] * vector(lamps[a + 3], lamps[a + 4], lamps[a + 5])
           + v[2] * vector(lamps[a + 6], lamps[a + 7], lamps[a + 8]);
}

//@ lamp_functions

#if RIG_PROFILED
// A profile of lookdev/light/ies.py in directions of two angles in degrees.
float lamp_profile(float profiles[], int place, float scale, float angle_scale, float down, float around)
{
    float vertical = down;
    if (angle_scale > 0)
        vertical = down / angle_scale;
    else if (angle_scale < 0)
        vertical = (down - 180) / -angle_scale + 180;
    int rows = int(profiles[place]);
    int columns = int(profiles[place + 1]);
    int table = place + 2;
    if (vertical < profiles[table + 1] || vertical > profiles[table + columns - 1])
        return 0;
    int v = 1;
    for (int step = columns; step > 0; step /= 2)
        while (v + step <= columns - 2 && profiles[table + v + step] <= vertical)
            v += step;
    int h = 1;
    for (int step = rows; step > 0; step /= 2)
        while (h + step <= rows - 2 && profiles[table + (h + step) * columns] <= around)
            h += step;
    int cell = table + h * columns;
    float s = (vertical - profiles[table + v]) / (profiles[table + v + 1] - profiles[table + v]);
    float t = (around - profiles[cell]) / (profiles[cell + columns] - profiles[cell]);
    return scale * ((1 - t) * ((1 - s) * profiles[cell + v] + s * profiles[cell + v + 1])
                    + t * ((1 - s) * profiles[cell + columns + v] + s * profiles[cell + columns + v + 1]));
}
#endif

// What a lamp sends to places p along -w, both in its own space, but for its texture.
color lamp_sent(float lamps[], float profiles[], int at, vector p, vector w)
{
    color sent = color(lamps[at + LAMP_red], lamps[at + LAMP_green], lamps[at + LAMP_blue]);
#if RIG_SHAPED
    sent *= lamp_beam(lamps, at, w);
#endif
#if RIG_PROFILED
    if (lamps[at + LAMP_profile] >= 0) {
        float around = atan2(-w[1], -w[0]) / M_2PI;
        sent *= lamp_profile(profiles, int(lamps[at + LAMP_profile]), lamps[at + LAMP_profile_scale],
                             lamps[at + LAMP_angle_scale], degrees(atan2(hypot(w[0], w[1]), w[2])),
                             360 * (around - floor(around)));
    }
#endif
#if RIG_FALLING
    sent *= lamp_falloff(lamps, at, length(p));
#endif
    return sent;
}

#if RIG_LOCAL_DOMES
// A local dome at places p about its middle (lookdev/light/dome/local.py): the share of its light that arrives, the
// distance of its sphere along w, and the solid angle at its middle over that at p.
float local_dome_share(float lamps[], int at, vector p)
{
    float start = lamps[at + LAMP_a];
    float radius = lamps[at + LAMP_b];
    float away = length(p);
    if (away >= radius)
        return 0;
    float x = start < radius ? clamp((away - start) / (radius - start), 0, 1) : 0;
    return 1 - x * x * (3 - 2 * x);
}

float local_dome_distance(float radius, vector p, vector w)
{
    float along = dot(p, w);
    float left = radius * radius - dot(p, p);
    float rise = sqrt(max(along * along + left, 0));
    return along < 0 ? rise - along : left / (rise + along);
}

float local_dome_density(float radius, float distance, float cosine)
{
    return distance * distance / (radius * radius * cosine);
}
#endif
