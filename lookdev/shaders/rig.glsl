// Several lights in GLSL, as lookdev/shaders/rig.osl.h: lamps by rows of numbers, domes by their tables. A light is
// chosen for each drawn direction in proportion to an estimate of its irradiance.

#define RIG_FAR 1e30
#define RIG_INFINITE 1e20  // the distance of what is infinitely far
#define RIG_SIDES (TRANSMITS + 1)
#define RIG_SETS (RIG_SPARED > 0 ? RIG_SPARED : 1)
#define RIG_PLAIN (RIG_NEAREST == 0 && RIG_SPARED == 0)

uniform highp sampler2D rig_numbers;
uniform vec4 turns;

float rig_number(int place) { return texelFetch(rig_numbers, ivec2(place & 2047, place >> 11), 0).r; }
float rig_field(int light, int field) { return rig_number(3 + light * LAMP_FIELDS + field); }
vec3 rig_vector(int light, int field) {
    return vec3(rig_field(light, field), rig_field(light, field + 1), rig_field(light, field + 2));
}

// A vector of the world in the frame of lights that have turned about z, and back.
vec2 rig_turn(int light) { return rig_field(light, LAMP_turns) > 0.0 ? turns.xy : turns.zw; }
vec3 rig_back(vec3 v, vec2 turn) { return vec3(turn.y * v.x + turn.x * v.y, turn.y * v.y - turn.x * v.x, v.z); }
vec3 rig_forth(vec3 v, vec2 turn) { return vec3(turn.y * v.x - turn.x * v.y, turn.x * v.x + turn.y * v.y, v.z); }

// A vector of the lights' frame by the axes of a light; of the world, and back.
vec3 rig_by_axes(int light, vec3 v) {
    return vec3(dot(v, rig_vector(light, LAMP_x0)), dot(v, rig_vector(light, LAMP_y0)),
                dot(v, rig_vector(light, LAMP_z0)));
}
vec3 rig_inside(int light, vec3 v) { return rig_by_axes(light, rig_back(v, rig_turn(light))); }
vec3 rig_outside(int light, vec3 v) {
    return rig_forth(v.x * rig_vector(light, LAMP_x0) + v.y * rig_vector(light, LAMP_y0)
                     + v.z * rig_vector(light, LAMP_z0), rig_turn(light));
}

// A place, from the centre of the geometry, by the axes of a light.
vec3 rig_seen_from(int light, vec3 place) {
    vec3 from_axis = rig_back(place + vec3(rig_number(0), rig_number(1), rig_number(2)), rig_turn(light));
    return rig_by_axes(light, from_axis - rig_vector(light, LAMP_x));
}

//@ lamp_functions
//@ dome_functions

// Whether parts of a slot cast the shadow of lights that spare a set of parts.
bool rig_casts(int slot, int spared) {
#if RIG_SPARED > 0
    return rig_number(RIG_CASTING + spared * RIG_SLOTS + slot) > 0.0;
#else
    return true;
#endif
}
#if SHADOWS == 1
float occluder_distance(vec3 w, float reach, int spared, bool any);
#endif

// The surface: place, shading frame, slot; and of each side the lights' estimates of irradiance and their sum.
vec3 rig_place, rig_axes[3];
int rig_slot;
float rig_weights[RIG_SIDES * RIG_LIGHTS + 1], rig_sums[RIG_SIDES];  // no array has length 0
#if SHADOWS == 1
// Distances along a direction, for each set of parts that some light spares; RIG_FAR, as long as none are looked for.
float rig_occluders[RIG_SETS];
#endif
#if RIG_DOMES > 0
vec3 rig_bin_axes[RIG_SIDES * RIG_DOMES];
float rig_scales[RIG_SIDES * RIG_DOMES];
int rig_bins[RIG_SIDES * RIG_DOMES];
#endif

vec3 rig_side(int side) { return side == 0 ? rig_axes[2] : -rig_axes[2]; }
float rig_count(int side) { return float(side == 0 ? LIT - (RIG_SIDES - 1) * (LIT / 2) : LIT / 2); }
float rig_lit(int light) { return rig_number(RIG_MARKS + rig_slot * RIG_LIGHTS + light); }

void rig_meet_surface(vec3 place, vec3 tangent, vec3 bitangent, vec3 normal, int slot) {
    rig_place = place;
    rig_axes[0] = tangent;
    rig_axes[1] = bitangent;
    rig_axes[2] = normal;
    rig_slot = slot;
#if SHADOWS == 1
    for (int k = 0; k < RIG_SETS; ++k) rig_occluders[k] = RIG_FAR;
#endif
    for (int side = 0; side < RIG_SIDES; ++side) {
        rig_sums[side] = 0.0;
        for (int light = 0; light < RIG_LIGHTS; ++light) {
            float weight = 0.0;
#if RIG_LAMPS > 0
            if (light < RIG_LAMPS)
                lamp_weight(light, rig_seen_from(light, place), rig_inside(light, rig_side(side)), weight);
#endif
#if RIG_DOMES > 0
            if (light >= RIG_LAMPS) {
                int dome = light - RIG_LAMPS, at = side * RIG_DOMES + dome;
                float mean = rig_field(light, LAMP_mean);
                if (dome_constant[dome] == 1) {
                    weight = 3.141592653589793 * mean;
#if RIG_LOCAL_DOMES
                } else if (dome_local[dome] == 1) {
                    // Its bin of all directions; a quarter of the integral is a surface's irradiance, on the average.
                    rig_bins[at] = DOME_ALL;
                    rig_scales[at] = rig_number(dome_starts[dome] + 2 * DOME_ALL);
                    ball_share(light, rig_seen_from(light, place), weight);
                    weight *= rig_scales[at] > 0.0 ? 0.25 * mean / rig_scales[at] : 0.0;
#endif
                } else {
                    rig_bins[at] = dome_bin(rig_inside(light, rig_side(side)), rig_bin_axes[at]);
                    rig_scales[at] = rig_number(dome_starts[dome] + 2 * rig_bins[at]);
                    weight = rig_scales[at] > 0.0 ? mean / rig_scales[at] : 0.0;
                }
            }
#endif
            weight *= rig_lit(light);
            rig_weights[side * RIG_LIGHTS + light] = weight;
            rig_sums[side] += weight;
        }
    }
}

// The number of directions drawn of a light on a side.
float rig_drawn(int light, int side) {
    float sum = rig_sums[side];
    return sum > 0.0 ? rig_count(side) * rig_weights[side * RIG_LIGHTS + light] / sum : 0.0;
}

// The density of directions drawn of a lamp, whose own pdf is given.
float rig_lamp_density(int light, float pdf) {
    float drawn = 0.0;
    for (int side = 0; side < RIG_SIDES; ++side) drawn += rig_drawn(light, side);
    return drawn * pdf;
}

#if RIG_DOMES > 0
// The widened cosine of a dome's direction on a side; a local dome is drawn from all around.
float rig_dome_widened(int dome, int at, vec3 local) {
    return dome_local[dome] == 1 ? 1.0 : dome_widened(dot(local, rig_bin_axes[at]));
}

// The density of directions drawn of a dome: w of the world, `local` by its axes, `mean` of its map there.
float rig_dome_density(int dome, vec3 w, vec3 local, float mean) {
    float density = 0.0;
    for (int side = 0; side < RIG_SIDES; ++side) {
        int at = side * RIG_DOMES + dome;
        float pdf = dome_constant[dome] == 1 ? max(dot(w, rig_side(side)), 0.0) / 3.141592653589793
                                             : rig_scales[at] * rig_dome_widened(dome, at, local) * mean;
        density += rig_drawn(RIG_LAMPS + dome, side) * pdf;
    }
    return density;
}

// Where a dome's map is seen along a direction by its axes: its share of the light, the distance, and the solid angle
// for that of the map. A local dome is a sphere about its place.
vec3 rig_dome_onto(int dome, vec3 place, vec3 local, out float share, out float distance, out float around) {
    share = around = 1.0;
    distance = RIG_INFINITE;
#if RIG_LOCAL_DOMES
    if (dome_local[dome] == 1) {
        int light = RIG_LAMPS + dome;
        vec3 p = rig_seen_from(light, place);
        float within;
        ball_share(light, p, share);
        ball_meet(light, p, local, within, distance, around);
        share *= within;
        return (p + distance * local) / rig_field(light, LAMP_b);
    }
#endif
    return local;
}
#endif

int rig_spares(int light) {
#if RIG_SPARED > 0
    return int(rig_field(light, LAMP_spares));
#else
    return 0;
#endif
}

#if SHADOWS == 1
// Find the occluders of a light at a distance along w; or those of all lights, -1.
void rig_meet_occluders(vec3 w, int light, float distance) {
    int first = light < 0 ? 0 : rig_spares(light), last = light < 0 ? RIG_SETS - 1 : first;
    bool any = RIG_NEAREST == 0 || (light >= 0 && RIG_SHADOWED == 0);
    for (int k = first; k <= last; ++k) rig_occluders[k] = occluder_distance(w, distance, k, any);
}

// The share of a light, at a distance, that passes the occluders that were met.
vec3 rig_passed(int light, float distance) {
    float occluder = rig_occluders[rig_spares(light)];
    if (distance <= occluder) return vec3(1.0);
    vec3 passed = vec3(0.0);
#if RIG_SHADOWED
    lamp_passed(light, occluder, passed);
#endif
    return passed;
}
#endif

// The sum over lights of the radiance from w over the density of all that draws it: `own`, and that of directions drawn
// of the light if `weighed` is 1. What diffuse lobes have of it is `diffuse`, the rest what others have.
vec3 rig_arriving(vec3 w, float own, float weighed, out vec3 diffuse) {
    vec3 total = vec3(0.0);
    diffuse = vec3(0.0);
    for (int light = 0; light < RIG_LIGHTS; ++light) {
        if (rig_lit(light) == 0.0) continue;
        vec3 local = rig_inside(light, w), found = vec3(0.0);
        float distance;
#if RIG_LAMPS > 0
        if (light < RIG_LAMPS) {
            vec3 p = rig_seen_from(light, rig_place);
            float pdf;
            lamp_meet(light, p, local, distance, pdf);
            if (distance < RIG_FAR) {
                lamp_sent(light, p, local, found);
                found /= own + weighed * rig_lamp_density(light, pdf);
            }
        }
#endif
#if RIG_DOMES > 0
        if (light >= RIG_LAMPS) {
            int dome = light - RIG_LAMPS;
            float share, around;
            vec3 onto = rig_dome_onto(dome, rig_place, local, share, distance, around), radiance = dome_map(dome, onto);
            float mean = (radiance.r + radiance.g + radiance.b) / 3.0;
            float density = own + weighed * around * rig_dome_density(dome, w, onto, mean);
            found = share * radiance * rig_vector(light, LAMP_red) / density;
        }
#endif
#if SHADOWS == 1
        found *= rig_passed(light, distance);
#endif
#if RIG_SPLIT
        diffuse += rig_field(light, LAMP_diffuse) * found;
        found *= rig_field(light, LAMP_specular);
#endif
        total += found;
    }
    return total;
}

// Draw a direction of the lights by two numbers: returns the radiance from there, corrected where it was not drawn with
// the density of all that draws it, and sets w, that density, the light and its distance.
vec3 rig_draw(int side, float u1, float u2, out vec3 w, out float density, out int light, out float distance) {
    w = rig_side(side);
    density = 1.0;
    distance = RIG_INFINITE;
    light = 0;
    float wanted = u1 * rig_sums[side], before = 0.0, weight = 0.0;
    for (int k = 0; k < RIG_LIGHTS; ++k) {
        // The last light with a weight, where rounding lets `wanted` reach the sum.
        float here = rig_weights[side * RIG_LIGHTS + k];
        if (here > 0.0 && wanted >= before) {
            light = k;
            weight = here;
            if (wanted < before + here) break;
        }
        before += here;
    }
    if (weight <= 0.0) return vec3(0.0);
    u1 = clamp((wanted - before) / weight, 0.0, 0.99999994);
    vec3 local = vec3(0.0, 0.0, 1.0), radiance = vec3(0.0);
#if RIG_LAMPS > 0
    if (light < RIG_LAMPS) {
        vec3 p = rig_seen_from(light, rig_place);
        float pdf;
        lamp_draw(light, p, u1, u2, local, distance, pdf);
        if (distance >= RIG_FAR) return vec3(0.0);
        lamp_sent(light, p, local, radiance);
        w = rig_outside(light, local);
        density = rig_lamp_density(light, pdf);
    }
#endif
#if RIG_DOMES > 0
    if (light >= RIG_LAMPS) {
        int dome = light - RIG_LAMPS, at = side * RIG_DOMES + dome;
        vec3 color = rig_vector(light, LAMP_red);
        if (dome_constant[dome] == 1) {
            // In proportion to the cosine.
            vec2 turn = look_turn(6.283185307179586 * u2);
            w = sqrt(u1) * (turn.y * rig_axes[0] + turn.x * rig_axes[1]) + sqrt(1.0 - u1) * rig_side(side);
            radiance = color;
            density = rig_dome_density(dome, w, w, 1.0);
        } else {
            float ratio, count = rig_number(dome_starts[dome] + 2 * rig_bins[at] + 1);
            radiance = dome_drawn(dome, rig_bins[at], count, u1, u2, local, ratio);
            float mean = (radiance.r + radiance.g + radiance.b) / 3.0, share = 1.0, around = 1.0;
            vec3 onto = local;
#if RIG_LOCAL_DOMES
            if (dome_local[dome] == 1) {
                ball_draw(light, rig_seen_from(light, rig_place), onto, local);
                rig_dome_onto(dome, rig_place, local, share, distance, around);
            }
#endif
            w = rig_outside(light, local);
            density = around * rig_dome_density(dome, w, onto, mean);
            radiance *= share * ratio * rig_dome_widened(dome, at, onto) * color;
        }
    }
#endif
    return radiance;
}

#if RIG_SEEN
// The light of lamps that the camera sees before the surface at a distance; returns whether there is any.
bool rig_before(vec3 eye, vec3 along, float reach, out vec3 seen) {
    bool hides = false;
    seen = vec3(0.0);
    for (int light = 0; light < RIG_LAMPS; ++light) {
        if (rig_field(light, LAMP_camera) <= 0.0) continue;
        vec3 p = rig_seen_from(light, eye), local = rig_inside(light, along), sent;
        float distance, pdf;
        lamp_meet(light, p, local, distance, pdf);
        if (distance < reach) {
            lamp_sent(light, p, local, sent);
            seen += sent;
            hides = true;
        }
    }
    return hides;
}
#endif

// What is seen of the lights where there is no surface: domes, and lamps that the camera sees.
vec3 rig_behind(vec3 eye, vec3 along) {
    vec3 seen = vec3(0.0);
#if RIG_SEEN
    rig_before(eye, along, RIG_FAR, seen);
#endif
#if RIG_DOMES > 0
    for (int dome = 0; dome < RIG_DOMES; ++dome) {
        int light = RIG_LAMPS + dome;
        if (dome_local[dome] == 1 && rig_field(light, LAMP_camera) <= 0.0) continue;
        float share, distance, around;
        vec3 onto = rig_dome_onto(dome, eye, rig_inside(light, along), share, distance, around);
        seen += share * dome_map(dome, onto) * rig_vector(light, LAMP_red);
    }
#endif
    return seen;
}
