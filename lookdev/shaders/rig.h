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

//@ shape_functions

#if RIG_PICTURES > 0
// A textured rectangle by quadrants of quadrants (lookdev/light/picture.py); `tree` is the place of their means.
float picture_weight(float lamps[], float tables[], int at, int tree, int side, int row, int column, vector p)
{
    // The levels before have 4 + 16 + ... cells.
    int level = tree + (side * side - 4) / 3;
    return tables[level + row * side + column]
           * rect_part_angle(lamps, at, p, float(column) / side, float(row) / side, 1.0 / side);
}

void picture_draw(float lamps[], float tables[], int at, vector p, float u1, float u2,
                  output vector w, output float distance, output float pdf)
{
    int tree = int(lamps[at + LAMP_tree]);
    int row = 0;
    int column = 0;
    float s = u1;
    float t = u2;
    float share = 1;
    int side = 1;
    for (int level = 0; level < PICTURE_LEVELS; ++level) {
        side *= 2;
        row *= 2;
        column *= 2;
        float w00 = picture_weight(lamps, tables, at, tree, side, row, column, p);
        float w01 = picture_weight(lamps, tables, at, tree, side, row, column + 1, p);
        float w10 = picture_weight(lamps, tables, at, tree, side, row + 1, column, p);
        float w11 = picture_weight(lamps, tables, at, tree, side, row + 1, column + 1, p);
        float sum = w00 + w01 + w10 + w11;
        float left = (w00 + w10) / sum;
        int right = s >= left;
        s = clamp(right ? (s - left) / (1 - left) : s / left, 0, 0.99999994);
        float lower = (right ? w01 : w00) / (right ? w01 + w11 : w00 + w10);
        int upper = t >= lower;
        t = clamp(upper ? (t - lower) / (1 - lower) : t / lower, 0, 0.99999994);
        column += right;
        row += upper;
        share *= (right ? (upper ? w11 : w01) : (upper ? w10 : w00)) / sum;
    }
    rect_part_draw(lamps, at, p, float(column) / side, float(row) / side, 1.0 / side, s, t, w, distance, pdf);
    pdf *= share;
}

void picture_meet(float lamps[], float tables[], int at, vector p, vector w, output float distance, output float pdf)
{
    float s;
    float t;
    rect_place(lamps, at, p, w, distance, s, t);
    pdf = 0;
    if (distance < FAR) {
        int tree = int(lamps[at + LAMP_tree]);
        int cells = 1 << PICTURE_LEVELS;
        int row = clamp(int(t * cells), 0, cells - 1);
        int column = clamp(int(s * cells), 0, cells - 1);
        float share = 1;
        for (int level = 1; level <= PICTURE_LEVELS; ++level) {
            int side = 1 << level;
            int down = PICTURE_LEVELS - level;
            int i = row >> down;
            int j = column >> down;
            int i0 = i & ~1;
            int j0 = j & ~1;
            float w00 = picture_weight(lamps, tables, at, tree, side, i0, j0, p);
            float w01 = picture_weight(lamps, tables, at, tree, side, i0, j0 + 1, p);
            float w10 = picture_weight(lamps, tables, at, tree, side, i0 + 1, j0, p);
            float w11 = picture_weight(lamps, tables, at, tree, side, i0 + 1, j0 + 1, p);
            share *= ((i & 1) ? ((j & 1) ? w11 : w10) : ((j & 1) ? w01 : w00)) / (w00 + w01 + w10 + w11);
        }
        pdf = share * rect_part_density(lamps, at, p, w, float(column) / cells, float(row) / cells, 1.0 / cells);
    }
}
#endif

//@ lamp_functions

#if RIG_PROFILED
// A profile of lookdev/light/ies.py in directions of two angles in degrees.
float lamp_profile(float tables[], int place, float scale, float angle_scale, float down, float around)
{
    float vertical = down;
    if (angle_scale > 0)
        vertical = down / angle_scale;
    else if (angle_scale < 0)
        vertical = (down - 180) / -angle_scale + 180;
    int rows = int(tables[place]);
    int columns = int(tables[place + 1]);
    int table = place + 2;
    if (vertical < tables[table + 1] || vertical > tables[table + columns - 1])
        return 0;
    int v = 1;
    for (int step = columns; step > 0; step /= 2)
        while (v + step <= columns - 2 && tables[table + v + step] <= vertical)
            v += step;
    int h = 1;
    for (int step = rows; step > 0; step /= 2)
        while (h + step <= rows - 2 && tables[table + (h + step) * columns] <= around)
            h += step;
    int cell = table + h * columns;
    float s = (vertical - tables[table + v]) / (tables[table + v + 1] - tables[table + v]);
    float t = (around - tables[cell]) / (tables[cell + columns] - tables[cell]);
    return scale * ((1 - t) * ((1 - s) * tables[cell + v] + s * tables[cell + v + 1])
                    + t * ((1 - s) * tables[cell + columns + v] + s * tables[cell + columns + v + 1]));
}
#endif

// What a lamp sends to places p along -w, both in its own space, but for its texture.
color lamp_sent(float lamps[], float tables[], int at, vector p, vector w)
{
    color sent = color(lamps[at + LAMP_red], lamps[at + LAMP_green], lamps[at + LAMP_blue]);
#if RIG_SHAPED
    sent *= lamp_beam(lamps, at, w);
#endif
#if RIG_PROFILED
    if (lamps[at + LAMP_profile] >= 0) {
        float around = atan2(-w[1], -w[0]) / M_2PI;
        sent *= lamp_profile(tables, int(lamps[at + LAMP_profile]), lamps[at + LAMP_profile_scale],
                             lamps[at + LAMP_angle_scale], degrees(atan2(hypot(w[0], w[1]), w[2])),
                             360 * (around - floor(around)));
    }
#endif
#if RIG_FALLING
    sent *= lamp_falloff(lamps, at, length(p));
#endif
    return sent;
}

#if RIG_SPARED > 0
// The group of the surface that trace() has hit: the angle between its facet and the normal that Blender's mesh has there
// (cycles/geometry.py), of which the shading normal is independent.
int rig_group()
{
    normal facet = 0;
    normal coded = 0;
    getmessage("trace", "Ng", facet);
    getmessage("trace", "N", coded);
    return int(floor(degrees(atan2(length(cross(facet, coded)), abs(dot(facet, coded)))) + 0.5));
}

// How far the occluders of lights are, by what a light spares; the ray from `start` has hit something.
void rig_occluders(float spared[], point start, vector w, float lift, output float occluders[])
{
    float step = lift;
    float travelled = 0;
    int open = RIG_SPARED;
    int met = 1;
    while (met) {
        float ahead = 0;
        getmessage("trace", "hitdist", ahead);
        travelled += ahead;
        int group = rig_group();
        for (int i = 0; i < RIG_SPARED; ++i)
            if (occluders[i] >= FAR && (group >= RIG_GROUPS || spared[i * RIG_GROUPS + group] == 0)) {
                occluders[i] = travelled;
                open -= 1;
            }
        met = 0;
        if (open > 0) {
            // The same surface, once more for rounding, is spared again.
            step = ahead < step ? 2 * step : lift;
            travelled += step;
            met = trace(start + travelled * w, w);
        }
    }
}
#endif

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
