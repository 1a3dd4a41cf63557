//@ section behind
// What is seen of the lights at the middle of each pixel, as if there were no surface.
layout(location = 0) out vec4 radiance;
void main() { radiance = vec4(rig_behind(eye, normalize(film_ray(gl_FragCoord.xy))), 1.0); }
//@ section develop
// A film as code values: the mean of its samples over what is behind them, exposed, by the view of OpenColorIO. Alpha is
// coverage.
uniform sampler2D sums, lights;
uniform float samples, exposure, behind;
uniform int lit;
layout(location = 0) out vec4 shown;
void main() {
    ivec2 at = ivec2(gl_FragCoord.xy);
    vec4 mean = texelFetch(sums, at, 0) / samples;
    vec3 seen = lit == 1 ? exposure * texelFetch(lights, at, 0).rgb : vec3(behind);
    vec3 light = exposure * mean.rgb + (1.0 - mean.a) * seen;
    // No number of a sound scene is NaN or infinite: where one is, it is seen.
    bool broken = any(isnan(light)) || any(isinf(light));
    shown = vec4(broken ? vec3(1.0, 0.0, 1.0) : clamp(view(vec4(light, 1.0)).rgb, 0.0, 1.0), mean.a);
}
