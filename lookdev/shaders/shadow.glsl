// Rays from a surface to its occluders, by the hierarchy of lookdev/studio/viewport/hierarchy.py: its texels are those of
// `corners` from OCCLUDERS on.

#if SHADOWS == 1
uniform float lift;  // metres above its facet at which a ray leaves a surface

vec4 occluder_texel(int place) {
    place += OCCLUDERS;
    return texelFetch(corners, ivec2(place & (CORNERS_WIDTH - 1), place >> CORNERS_SHIFT), 0);
}

// The distance along w to an occluder before `reach`, of a set of parts that a light spares: to the nearest one, or to
// `any`; RIG_FAR: there is none.
float occluder_distance(vec3 w, float reach, int spared, bool any) {
    float side = dot(w, surface_facet);
#if CONVEX
    if (side * (1.0 - 2.0 * inside) > 0.0) return RIG_FAR;
#endif
    vec3 start = surface_point + (side < 0.0 ? -lift : lift) * surface_facet;
    // Along an axis w is 0 a ray stays within a box, or outside: no quotient is NaN, as 0 times infinity is.
    vec3 slope = 1.0 / mix(w, vec3(1e-20), lessThan(abs(w), vec3(1e-20)));
    vec4 grid = occluder_texel(0);
    vec3 origin = (start - grid.xyz) / grid.w, step = grid.w * slope;
    float nearest = reach;
    int leaving = surface_corner / 3, node = 0;
    while (node < OCCLUDER_NODES) {
        // To the next leaf that is met: neighbouring pixels then test triangles together (Aila and Laine 2009).
        int place = 0;
        while (place == 0 && node < OCCLUDER_NODES) {
            vec4 texel = occluder_texel(1 + node);
            uvec3 cells = floatBitsToUint(texel.xyz) - FIRST_BITS;
            vec3 a = (vec3(cells & 0x7fffu) - origin) * step, b = (vec3(cells >> 15) - origin) * step;
            vec3 near = min(a, b), far = max(a, b);
            float entry = max(max(near.x, near.y), max(near.z, 0.0)), exit = min(min(far.x, far.y), min(far.z, nearest));
            // Widened by the rounding of both (Ize, "Robust BVH Ray Traversal", 2013).
            bool met = entry <= exit * 1.0000006, leaf = texel.w < 0.0;
            node = met || leaf ? node + 1 : int(texel.w);
            if (met && leaf) place = 1 + OCCLUDER_NODES - 3 * int(1.0 + texel.w);
        }
        bool left = place > 0;
        while (left) {  // Moeller and Trumbore 1997
            vec4 corner = occluder_texel(place), one = occluder_texel(place + 1), other = occluder_texel(place + 2);
            vec3 p = cross(w, other.xyz), from = start - corner.xyz, q = cross(from, one.xyz);
            float scale = 1.0 / dot(one.xyz, p), w1 = dot(from, p) * scale, w2 = dot(w, q) * scale;
            float distance = dot(other.xyz, q) * scale;
            if (w1 >= 0.0 && w2 >= 0.0 && w1 + w2 <= 1.0 && distance > 0.0 && distance < nearest
                && int(corner.w) != leaving && rig_casts(int(one.w), spared)) {
                if (any) return distance;
                nearest = distance;
            }
            left = other.w == 0.0;
            place += 3;
        }
    }
    return nearest < reach ? nearest : RIG_FAR;
}
#endif
