// A film on the screen: the mean of its samples over what is seen of the lights, exposed, by the view of OpenColorIO.
uniform sampler2D sums;
uniform float samples, exposure, behind;
uniform int lights;
layout(location = 0) out vec4 shown;
void main() {
    vec2 at = gl_FragCoord.xy / vec2(size);
    ivec2 film = textureSize(sums, 0);
    vec4 mean = texelFetch(sums, min(ivec2(at * vec2(film)), film - 1), 0) / samples;
    vec3 seen = vec3(behind);
    if (lights == 1) seen = exposure * rig_behind(eye, normalize(film_ray(gl_FragCoord.xy)));
    vec3 light = exposure * mean.rgb + (1.0 - mean.a) * seen;
    // No number of a sound scene is NaN or infinite: where one is, it is seen.
    bool broken = any(isnan(light)) || any(isinf(light));
    shown = broken ? vec4(1.0, 0.0, 1.0, 1.0) : vec4(clamp(view(vec4(light, 1.0)).rgb, 0.0, 1.0), 1.0);
}
