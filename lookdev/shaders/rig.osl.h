// Several lights in the shader of a look, by sections (codegen/osl/rig.py). Those of domes and pictures are repeated for
// each, with its number for `@`, and that of a dome's light for `#`. A local dome without a section has that of a dome.
// `here` and `side` are P and the shading normal in the frame of the lights that turn, `..._still` in that of the others.

//@ section macros
#if RIG_SPLIT
#define RIG_REFLECTED(at, f, f_diffuse) (straight ? f : lamps[at + LAMP_specular] * f \
                                         + (lamps[at + LAMP_diffuse] - lamps[at + LAMP_specular]) * f_diffuse)
#else
#define RIG_REFLECTED(at, f, f_diffuse) f
#endif
#if RIG_SPARED > 0
#define RIG_OCCLUDER(at) occluders[int(lamps[at + LAMP_spares])]
#else
#define RIG_OCCLUDER(at) occluder
#endif
#if RIG_SHADOWED
#define RIG_PASSED(at, distance) (distance > RIG_OCCLUDER(at) ? lamp_passed(lamps, at, RIG_OCCLUDER(at)) : color(1))
#else
#define RIG_PASSED(at, distance) (distance > RIG_OCCLUDER(at) ? 0 : 1)
#endif
#if RIG_PICTURES > 0
// The texture of a lamp, if it has one, where a ray meets it.
color lamp_picture(float lamps[], int at, vector p, vector w, float distance
//@ pictures arguments
                   )
{
    color picture = 1;
    float s = 0.5 - (p[0] + distance * w[0]) / lamps[at + LAMP_a];
    float t = 0.5 + (p[1] + distance * w[1]) / lamps[at + LAMP_b];
    float alpha;
//@ pictures look_up
    return picture;
}
#define RIG_SENT(at, p, w, distance) \
    (lamp_sent(lamps, tables, at, p, w) * lamp_picture(lamps, at, p, w, distance \
//@ pictures names
    ))
#else
#define RIG_SENT(at, p, w, distance) lamp_sent(lamps, tables, at, p, w)
#endif
#if RECORDED
#define RIG_ADD(at, arriving, distance) { \
    color arrived = (arriving) * RIG_PASSED(at, distance); \
    color reflected = RIG_REFLECTED(at, f, f_diffuse) * arrived; \
    direct += reflected; \
    by_light[light_groups[(at - 3) / LAMP_FIELDS]] += reflected; \
    for (int g = 0; g < RECORDED_LOBES; ++g) \
        by_lobe[g] += RIG_REFLECTED(at, f_lobe[g], f_lobe_diffuse[g]) * arrived; }
#else
#define RIG_ADD(at, arriving, distance) \
    direct += RIG_REFLECTED(at, f, f_diffuse) * (arriving) * RIG_PASSED(at, distance);
#endif
// Directions that are drawn of a light.
#if IBL_SAMPLES > 0
#define RIG_SHARE(sums, sum, j) ((sums[j] - (j > 0 ? sums[j - 1] : 0)) / sum)
#if TRANSMITS
#define RIG_SUM(j) (back ? lit_back[j] : lit_front[j])
#define RIG_DRAWN(j) (front_samples * RIG_SHARE(lit_front, front_sum, j) \
                      + back_samples * RIG_SHARE(lit_back, back_sum, j))
#define RIG_BOTH(j, front_pdf, back_pdf) (front_samples * RIG_SHARE(lit_front, front_sum, j) * (front_pdf) \
                                          + back_samples * RIG_SHARE(lit_back, back_sum, j) * (back_pdf))
#else
#define RIG_SUM(j) lit_front[j]
#define RIG_DRAWN(j) (front_samples * RIG_SHARE(lit_front, front_sum, j))
#define RIG_BOTH(j, front_pdf, back_pdf) (front_samples * RIG_SHARE(lit_front, front_sum, j) * (front_pdf))
#endif
#else
#define RIG_DRAWN(j) 0
#define RIG_BOTH(j, front_pdf, back_pdf) 0
#endif
//@ domes macros
//@ section parameters
    // The worker writes the values of arrays.
    float lamps[RIG_SIZE] = {0},
    float tables[RIG_TABLES] = {0},
#if RIG_SPARED > 0
    float spared[RIG_MARKS] = {0},
#endif
//@ pictures parameters
//@ domes parameters
//@ section setup
    float still = 0;
#if RIG_STILL
    still = -2 * M_2PI * (control[2] / samples - 1);
#endif
    vector here = rig_back(P + vector(lamps[0], lamps[1], lamps[2]), turn);
    vector here_still = rig_back(P + vector(lamps[0], lamps[1], lamps[2]), still);
#if IBL_SAMPLES > 0
    // Estimates of the irradiance by each light, summed up.
    vector side = rig_back(n, turn);
    vector side_still = rig_back(n, still);
    float lit_front[RIG_LIGHTS];
    float front_sum = 0;
#if TRANSMITS
    float lit_back[RIG_LIGHTS];
    float back_sum = 0;
#endif
#if RIG_LAMPS > 0
    for (int j = 0; j < RIG_LAMPS; ++j) {
        int at = 3 + j * LAMP_FIELDS;
        int turns = lamps[at + LAMP_turns] > 0;
        vector from_lamp = (turns ? here : here_still) - lamp_position(lamps, at);
        vector facing = turns ? side : side_still;
        // Many lights are below the horizon.
        float below = dot(from_lamp, facing);
        float reach = lamps[at + LAMP_reach] > 0 ? lamps[at + LAMP_reach] : FAR;
#if TRANSMITS
        vector p = lamp_inside(lamps, at, from_lamp);
        vector face = lamp_inside(lamps, at, facing);
        if (below < reach)
            front_sum += lamp_weight(lamps, at, p, face);
        if (-below < reach)
            back_sum += lamp_weight(lamps, at, p, -face);
        lit_back[j] = back_sum;
#else
        if (below < reach)
            front_sum += lamp_weight(lamps, at, lamp_inside(lamps, at, from_lamp), lamp_inside(lamps, at, facing));
#endif
        lit_front[j] = front_sum;
    }
#endif
//@ domes setup
#endif
//@ section seen
    // Of the lamps that the camera sees, those before the surface are shown instead of it.
    float start = 0;
    getattribute("path:ray_length", start);
    color before = 0;
    int hidden = 0;
    for (int j = 0; depth == 0 && j < RIG_LAMPS; ++j) {
        int at = 3 + j * LAMP_FIELDS;
        int turns = lamps[at + LAMP_turns] > 0;
        vector from_lamp = (turns ? here : here_still) - lamp_position(lamps, at);
        vector w = lamp_inside(lamps, at, rig_back(-I, turns ? turn : still));
        vector p = lamp_inside(lamps, at, from_lamp) - start * w;
        float distance;
        float pdf_of_light;
        lamp_meet(lamps, tables, at, p, w, distance, pdf_of_light);
        if (lamps[at + LAMP_camera] > 0 && distance < start) {
            before += RIG_SENT(at, p, w, distance);
            hidden = 1;
#if RECORDED
            by_light[light_groups[j]] += RIG_SENT(at, p, w, distance);
#endif
        }
    }
    if (hidden) {
        surface = before * emission();
#if RECORDED
        color parts[3];
        for (int r = 0; r < 3; ++r)
            parts[r] = part_of_light(records[r], r, 1, before, by_lobe, lobes, by_light, digits);
        surface += recording(normal(I), parts);
#endif
        return;
    }
//@ section sample
            float u1;
            float u2;
#if TRANSMITS
            sobol_2d(number, sobol_hash(seed + 0x1b873593 + back), u1, u2);
            float wanted = u1 * (back ? back_sum : front_sum);
#else
            sobol_2d(number, sobol_hash(seed + 0x1b873593), u1, u2);
            float wanted = u1 * front_sum;
#endif
            light = 0;
            float before = 0;
            float reached = RIG_SUM(0);
            while (light < RIG_LIGHTS - 1 && reached <= wanted) {
                light += 1;
                before = reached;
                reached = RIG_SUM(light);
            }
            if (reached <= before)
                continue;
            u1 = clamp((wanted - before) / (reached - before), 0, 0.99999994);
            int at = 3 + light * LAMP_FIELDS;
            int turns = lamps[at + LAMP_turns] > 0;
            vector drawn = 0;
            float pdf_of_light = 0;
            vector p = lamp_inside(lamps, at, (turns ? here : here_still) - lamp_position(lamps, at));
#if RIG_LAMPS > 0
            if (light < RIG_LAMPS) {
                lamp_draw(lamps, tables, at, p, u1, u2, drawn, light_distance, pdf_of_light);
                if (light_distance < FAR)
                    radiance = RIG_SENT(at, p, drawn, light_distance);
                light_density = RIG_DRAWN(light) * pdf_of_light;
            }
#endif
//@ domes sample
            wi = rig_forth(lamp_outside(lamps, at, drawn), turns ? turn : still);
//@ section arrive
            vector towards = rig_back(wi, turn);
            vector towards_still = rig_back(wi, still);
#if RIG_LAMPS > 0
            for (int j = 0; j < RIG_LAMPS; ++j) {
                int at = 3 + j * LAMP_FIELDS;
                int turns = lamps[at + LAMP_turns] > 0;
                vector w = turns ? towards : towards_still;
                vector p = (turns ? here : here_still) - lamp_position(lamps, at);
                // Most lights are missed by far.
                vector across = cross(p, w);
                if (lamps[at + LAMP_reach] > 0 && dot(across, across) > 1.0001 * lamps[at + LAMP_reach] * lamps[at + LAMP_reach])
                    continue;
                p = lamp_inside(lamps, at, p);
                w = lamp_inside(lamps, at, w);
                float distance;
                float pdf_of_light;
                lamp_meet(lamps, tables, at, p, w, distance, pdf_of_light);
                if (distance >= FAR)
                    continue;
                float density = own_density + weighed * RIG_DRAWN(j) * pdf_of_light;
                RIG_ADD(at, RIG_SENT(at, p, w, distance) / density, distance)
            }
#endif
//@ domes arrive
//@ section picture_parameters
    string picture@ = "",
//@ section picture_arguments
                   , string picture@
//@ section picture_names
    , picture@ \
//@ section picture_look_up
    if (lamps[at + LAMP_picture] == @)
        picture = lookdev_texture(picture@, s, t, "clamp", "clamp", alpha);
//@ section dome_macros
#define DOME@_DENSITY(w) RIG_BOTH(#, scale@ * dome_widened(dot(w, axis@)), back_scale@ * dome_widened(dot(w, back_axis@)))
//@ section dome_parameters
    string dome@_radiance = "",
#if IBL_SAMPLES > 0
    string dome@_points = "",
    int dome@_slots[DOME_ALL_SLOTS] = {0},
    float dome@_bins[DOME_BIN_NUMBERS] = {0},
#endif
//@ section dome_setup
    int at@ = 3 + # * LAMP_FIELDS;
    vector normal@ = lamp_inside(lamps, at@, lamps[at@ + LAMP_turns] > 0 ? side : side_still);
    vector axis@;
    int bin@ = dome_bin(normal@, 0, axis@);
    float scale@ = dome@_bins[2 * bin@];
    front_sum += scale@ > 0 ? lamps[at@ + LAMP_mean] / scale@ : 0;
    lit_front[#] = front_sum;
#if TRANSMITS
    vector back_axis@;
    int back_bin@ = dome_bin(-normal@, 0, back_axis@);
    float back_scale@ = dome@_bins[2 * back_bin@];
    back_sum += back_scale@ > 0 ? lamps[at@ + LAMP_mean] / back_scale@ : 0;
    lit_back[#] = back_sum;
#endif
//@ section dome_sample
            if (light == #) {
#if TRANSMITS
                int bin = back ? back_bin@ : bin@;
                vector axis = back ? back_axis@ : axis@;
#else
                int bin = bin@;
                vector axis = axis@;
#endif
                radiance = dome_sample(dome@_slots, dome@_bins, dome@_points, bin, dome_slot(u1), u2, 0, drawn, ratio);
                ratio *= dome_widened(dot(drawn, axis));
                float mean = (radiance[0] + radiance[1] + radiance[2]) / 3;
                light_density = DOME@_DENSITY(drawn) * mean;
                radiance *= color(lamps[at + LAMP_red], lamps[at + LAMP_green], lamps[at + LAMP_blue]);
                light_distance = 1e20;
            }
//@ section dome_arrive
            {
                int at = 3 + # * LAMP_FIELDS;
                vector w = lamp_inside(lamps, at, lamps[at + LAMP_turns] > 0 ? towards : towards_still);
                float map_x;
                float map_y;
                dome_place(w, 0, map_x, map_y);
                color arriving = dome_look_up(dome@_radiance, map_x, map_y, DOME@_WIDTH, DOME@_HEIGHT);
                float mean = (arriving[0] + arriving[1] + arriving[2]) / 3;
                float density = own_density + weighed * DOME@_DENSITY(w) * mean;
                arriving *= color(lamps[at + LAMP_red], lamps[at + LAMP_green], lamps[at + LAMP_blue]);
                RIG_ADD(at, arriving / density, 1e20)
            }
//@ section constant_dome_macros
#define DOME@_DENSITY(w) RIG_BOTH(#, max(dot(w, n), 0) / M_PI, max(-dot(w, n), 0) / M_PI)
//@ section constant_dome_parameters
//@ section constant_dome_setup
    int at@ = 3 + # * LAMP_FIELDS;
    front_sum += lamps[at@ + LAMP_mean] * M_PI;
    lit_front[#] = front_sum;
#if TRANSMITS
    back_sum += lamps[at@ + LAMP_mean] * M_PI;
    lit_back[#] = back_sum;
#endif
//@ section constant_dome_sample
            if (light == #) {
                // In proportion to the cosine.
                float s;
                float c;
                sincos(M_2PI * u2, s, c);
                float radius = sqrt(u1);
                vector up = back ? -n : n;
                vector world = radius * c * t + radius * s * b + sqrt(1 - u1) * up;
                drawn = lamp_inside(lamps, at, rig_back(world, turns ? turn : still));
                light_density = DOME@_DENSITY(world);
                radiance = color(lamps[at + LAMP_red], lamps[at + LAMP_green], lamps[at + LAMP_blue]);
                light_distance = 1e20;
            }
//@ section constant_dome_arrive
            {
                int at = 3 + # * LAMP_FIELDS;
                color arriving = color(lamps[at + LAMP_red], lamps[at + LAMP_green], lamps[at + LAMP_blue]);
                float density = own_density + weighed * DOME@_DENSITY(wi);
                RIG_ADD(at, arriving / density, 1e20)
            }
//@ section local_dome_macros
//@ section local_dome_setup
    int at@ = 3 + # * LAMP_FIELDS;
    // Its bin of all directions; a quarter of the integral is a surface's irradiance, on the average.
    float scale@ = dome@_bins[2 * DOME_ALL];
    vector local@ = (lamps[at@ + LAMP_turns] > 0 ? here : here_still) - lamp_position(lamps, at@);
    float share@ = 0.25 * local_dome_share(lamps, at@, local@);
    front_sum += scale@ > 0 ? share@ * lamps[at@ + LAMP_mean] / scale@ : 0;
    lit_front[#] = front_sum;
#if TRANSMITS
    back_sum += scale@ > 0 ? share@ * lamps[at@ + LAMP_mean] / scale@ : 0;
    lit_back[#] = back_sum;
#endif
//@ section local_dome_sample
            if (light == #) {
                vector onto;
                radiance = dome_sample(dome@_slots, dome@_bins, dome@_points, DOME_ALL, dome_slot(u1), u2, 0, onto, ratio);
                float mean = (radiance[0] + radiance[1] + radiance[2]) / 3;
                drawn = lamps[at + LAMP_b] * onto - p;
                light_distance = length(drawn);
                drawn /= max(light_distance, 1e-20);
                light_density = RIG_DRAWN(light) * scale@ * mean
                                * local_dome_density(lamps[at + LAMP_b], light_distance, dot(drawn, onto));
                radiance *= local_dome_share(lamps, at, p)
                            * color(lamps[at + LAMP_red], lamps[at + LAMP_green], lamps[at + LAMP_blue]);
            }
//@ section local_dome_arrive
            {
                int at = 3 + # * LAMP_FIELDS;
                int turns = lamps[at + LAMP_turns] > 0;
                vector w = lamp_inside(lamps, at, turns ? towards : towards_still);
                vector p = lamp_inside(lamps, at, (turns ? here : here_still) - lamp_position(lamps, at));
                float share = local_dome_share(lamps, at, p);
                if (share > 0) {
                    float distance = local_dome_distance(lamps[at + LAMP_b], p, w);
                    vector onto = (p + distance * w) / lamps[at + LAMP_b];
                    float map_x;
                    float map_y;
                    dome_place(onto, 0, map_x, map_y);
                    color arriving = dome_look_up(dome@_radiance, map_x, map_y, DOME@_WIDTH, DOME@_HEIGHT);
                    float density = own_density;
#if IBL_SAMPLES > 0
                    density += weighed * RIG_DRAWN(#) * scale@ * (arriving[0] + arriving[1] + arriving[2]) / 3
                               * local_dome_density(lamps[at + LAMP_b], distance, dot(w, onto));
#endif
                    arriving *= share * color(lamps[at + LAMP_red], lamps[at + LAMP_green], lamps[at + LAMP_blue]);
                    RIG_ADD(at, arriving / density, distance)
                }
            }
