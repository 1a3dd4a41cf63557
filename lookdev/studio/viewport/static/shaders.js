// @ts-check
// The shaders that depend on no scene: samples are added up, and pictures put on the canvas.

export const OVER_ALL = `#version 300 es
void main() { gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0, 0.0, 1.0); }`;
export const ADD = `#version 300 es
precision highp float;
precision highp sampler2D;
uniform sampler2D sums, sampled;
uniform float before;
layout(location = 0) out vec4 total;
void main() {
    ivec2 at = ivec2(gl_FragCoord.xy);
    total = texelFetch(sampled, at, 0);
    if (before > 0.0) total += texelFetch(sums, at, 0);
}`;

// The picture on the canvas. While a coarse film shows a change of the surface, what is behind the
// asset stays sharp.
// Right of the wipe stands the exact picture, or what it differs by.
export const PRESENT = `#version 300 es
precision highp float;
precision highp sampler2D;
uniform sampler2D film, whole, exact, sums, exact_sums;
uniform ivec2 canvas;
uniform int keep, differs;
uniform float wipe, samples, gain;
layout(location = 0) out vec4 shown;
void main() {
    vec2 place = gl_FragCoord.xy / vec2(canvas);
    ivec2 size = textureSize(film, 0);
    vec4 here = texelFetch(film, min(ivec2(place * vec2(size)), size - 1), 0);
    if (keep == 1) {
        vec4 before = texelFetch(whole, ivec2(gl_FragCoord.xy), 0);
        if (before.a == 0.0) here = before;
    }
    if (place.x >= wipe) here = texture(exact, place);
    if (differs == 1) {
        ivec2 many = textureSize(exact_sums, 0);
        vec4 right = texelFetch(exact_sums, min(ivec2(place * vec2(many)), many - 1), 0);
        vec4 left = texelFetch(sums, min(ivec2(place * vec2(size)), size - 1), 0) / samples;
        float apart = gain * dot(right.rgb - left.rgb, vec3(1.0 / 3.0));
        vec3 grey = vec3(max(left.a, right.a) > 0.0 ? 0.25 : 0.1);
        vec3 tint = apart > 0.0 ? vec3(1.0, 0.62, 0.2) : vec3(0.2, 0.55, 1.0);
        here.rgb = mix(grey, tint, min(1.0, abs(apart)));
    }
    shown = vec4(here.rgb, 1.0);
}`;
