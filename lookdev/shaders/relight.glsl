// The light that the seen surface reflects: directions of its BSDF and of the lights, weighed by the balance heuristic
// (Veach 1997), one set of low-discrepancy points over all frames of a pixel. What they meet occludes, and reflects nothing.

//@ section surface
uniform highp sampler2D corners;  // STRIDE texels of each corner of each triangle, in rows of CORNERS_WIDTH
uniform int sample_number, seed;

vec4 corner_texel(int corner, int k) {
    int place = corner * STRIDE + k;
    return texelFetch(corners, ivec2(place & (CORNERS_WIDTH - 1), place >> CORNERS_SHIFT), 0);
}

vec3 surface_weights;
int surface_corner;
vec4 carried(int k) {
    return surface_weights.x * corner_texel(surface_corner, k) + surface_weights.y * corner_texel(surface_corner + 1, k)
           + surface_weights.z * corner_texel(surface_corner + 2, k);
}

vec3 surface_point, surface_axes[3], surface_facet;
int surface_slot;

vec3 surface_world(vec3 w) { return w.x * surface_axes[0] + w.y * surface_axes[1] + w.z * surface_axes[2]; }
vec3 surface_local(vec3 w) {
    return vec3(dot(w, surface_axes[0]), dot(w, surface_axes[1]), dot(w, surface_axes[2]));
}

// Sets what the look reads of a triangle where a ray of the camera meets it (Moeller and Trumbore 1997).
void surface_meet(int triangle, vec3 ray) {
    surface_corner = 3 * triangle;
    vec3 p0 = corner_texel(surface_corner, 0).xyz;
    vec3 edge1 = corner_texel(surface_corner + 1, 0).xyz - p0, edge2 = corner_texel(surface_corner + 2, 0).xyz - p0;
    vec3 p = cross(ray, edge2), start = eye - p0, q = cross(start, edge1);
    // The rasteriser rounds corners to parts of pixels: at its edges a ray can miss the triangle.
    float scale = 1.0 / dot(edge1, p), w1 = clamp(dot(start, p) * scale, 0.0, 1.0);
    float w2 = clamp(dot(ray, q) * scale, 0.0, 1.0 - w1);
    surface_weights = vec3(1.0 - w1 - w2, w1, w2);
    mesh_facet = normalize(cross(edge1, edge2));
    vec4 place = carried(0), normal = carried(1);
    surface_point = place.xyz;
    hand = place.w;
    mesh_normal = normalize(normal.xyz);
    surface_slot = int(normal.w + 0.5);
    viewer = normalize(eye - surface_point);
    inside = dot(mesh_normal, mesh_facet) * dot(mesh_facet, viewer) < 0.0 ? 1.0 : 0.0;
//@ attributes
    look_read();
    look_frame(surface_axes[0], surface_axes[1], surface_axes[2], surface_facet);
    vec3 wo = surface_local(viewer);
    wo_x = wo.x;
    wo_y = wo.y;
    wo_z = wo.z;
}

// The seed of a pixel's points.
int surface_seed() {
    int pixel = int(gl_FragCoord.x) + (int(gl_FragCoord.y) << 14);
    return sobol_hash(sobol_hash(sobol_hash(seed) ^ pixel));
}
//@ section absent
bool absent() {
    surface_meet(int(triangle), film_ray(gl_FragCoord.xy));
    float presence;
    look_presence(presence);
    return sobol_unit(sobol_hash(surface_seed() ^ sobol_hash(sample_number * 0x2c1b3c6d + int(triangle)))) >= presence;
}
//@ section main
uniform highp usampler2D visible;
uniform ivec2 triangles;
uniform int shadowed;  // 0: no shadow is shown
uniform int places;  // of a pixel along each axis, at which is known what is seen
layout(location = 0) out vec4 reflected;

// A direction: the BSDF times the cosine, of which `diffuse` is of diffuse lobes, and the light over the density of all
// that draws it. It is of the light of a number, at a distance; or of all, -1: then `own` and `weighed` are those of
// rig_arriving.
struct Direction {
    vec3 w, value, diffuse, arriving, diffuse_arriving;
    float own, weighed, distance;
    int light;
};

vec3 reflected_from(Direction here) {
#if RIG_SPLIT
    return (here.value - here.diffuse) * here.arriving + here.diffuse * here.diffuse_arriving;
#else
    return here.value * here.arriving;
#endif
}

// Whether the shading normal and the facet agree on which side a direction is, and the look lets light be there.
bool agree(vec3 wi, vec3 w) {
    float height = dot(w, surface_facet);
#if SHADOWS == 2
    // A closed convex surface occludes what comes from inside it.
    if (shadowed == 1 && height * (1.0 - 2.0 * inside) < 0.0) return false;
#endif
#if TRANSMITS
    return wi.z * height > 0.0;
#else
    return wi.z > 0.0 && height > 0.0;
#endif
}

void main() {
    // Each pixel takes its places in an order of its own.
    int start = surface_seed();
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    sobol_2d(sample_number, sobol_hash(start + 0x632be5ab), u1, u2);
    ivec2 place = min(ivec2(vec2(u1, u2) * float(places)), places - 1);
    int triangle = int(texelFetch(visible, pixel * places + place, 0).r) - 1;
    if (triangle < triangles.x || triangle >= triangles.y) discard;
    surface_meet(triangle, film_ray(vec2(pixel) + (vec2(place) + 0.5) / float(places)));
    vec3 radiance = vec3(0.0);
#if RIG_SEEN
    if (rig_before(eye, -viewer, distance(eye, surface_point), radiance)) {
        reflected = vec4(radiance, 1.0);
        return;
    }
#endif
    rig_meet_surface(surface_point, surface_axes[0], surface_axes[1], surface_axes[2], surface_slot);
    Direction here;
#if SHADOWS == 1
    // A ray is traced along one direction of each side, chosen in proportion to the light where nothing occludes.
    Direction chosen[TRACED];
    vec2 chance, sum = vec2(0.0), share = vec2(0.0);
    sobol_2d(sample_number, sobol_hash(start + 0x7feb352d), chance.x, chance.y);
#endif
    for (int k = 0; k < DIRECTIONS; ++k) {
        int side = 0;
        vec3 wi;
        float density = 0.0;
        here.light = -1;
        here.own = 1.0;
        here.weighed = 0.0;
        here.distance = RIG_INFINITE;
        if (k < DRAWN) {
            sobol_2d(sample_number * DRAWN + k, start, u1, u2);
            look_draw(wi);
            here.w = surface_world(wi);
        } else if (k < DRAWN + LIT) {
            int j = k - DRAWN, front = LIT - TRANSMITS * (LIT / 2);
            side = j >= front ? 1 : 0;
            int count = side == 1 ? LIT / 2 : front;
            float v1, v2;
            sobol_2d(sample_number * count + j - side * front, sobol_hash(start + 0x1b873593 + side), v1, v2);
            here.arriving = rig_draw(side, v1, v2, here.w, density, here.light, here.distance);
            wi = surface_local(here.w);
            if (max(here.arriving.r, max(here.arriving.g, here.arriving.b)) <= 0.0) continue;
        }
//@ deltas
        if (!agree(wi, here.w)) continue;
        if (k < DRAWN + LIT) {
            float pdf;
            wi_x = wi.x;
            wi_y = wi.y;
            wi_z = wi.z;
#if RIG_SPLIT
            look_evaluate(here.value, pdf, here.diffuse);
#else
            look_evaluate(here.value, pdf);
#endif
            here.own = float(DRAWN) * pdf;
            here.weighed = 1.0;
        }
        if (max(here.value.r, max(here.value.g, here.value.b)) <= 1e-20) continue;
        if (here.light >= 0) {
            here.arriving /= here.own + density;
#if RIG_SPLIT
            here.diffuse_arriving = rig_field(here.light, LAMP_diffuse) * here.arriving;
            here.arriving *= rig_field(here.light, LAMP_specular);
#endif
        } else {
            if (here.own <= 0.0) continue;
            here.arriving = rig_arriving(here.w, here.own, here.weighed, here.diffuse_arriving);
        }
        vec3 found = reflected_from(here);
        radiance += found;
#if SHADOWS == 1
        side = TRANSMITS == 1 && wi.z < 0.0 ? 1 : 0;
        float part = found.r + found.g + found.b;
        if (part <= 0.0) continue;
        sum[side] += part;
        // What is left of the number is uniform again.
        float wanted = chance[side] * sum[side];
        bool taken = wanted < part;
        chance[side] = clamp(taken ? wanted / part : (wanted - part) / (sum[side] - part), 0.0, 0.99999994);
        if (taken) {
            chosen[side] = here;
            share[side] = part;
        }
#endif
    }
#if SHADOWS == 1
    if (shadowed == 1) {
        radiance = vec3(0.0);
        for (int side = 0; side < TRACED; ++side) {
            if (sum[side] <= 0.0) continue;
            here = chosen[side];
            rig_meet_occluders(here.w, here.light, here.distance);
            if (RIG_PLAIN || here.light >= 0) {
                vec3 passed = rig_passed(max(here.light, 0), here.distance);
                here.arriving *= passed;
                here.diffuse_arriving *= passed;
            }
#if !RIG_PLAIN
            if (here.light < 0)
                here.arriving = rig_arriving(here.w, here.own, here.weighed, here.diffuse_arriving);
#endif
            radiance += reflected_from(here) * sum[side] / share[side];
        }
    }
#endif
#if SEE_THROUGH
    // The surface is seen as often as it is present.
    float presence;
    look_presence(presence);
    radiance /= presence;
#endif
    reflected = vec4(radiance, 1.0);
}
