// @ts-check
// The shaders of the viewport that do not depend on the scene: they add up samples, and draw the
// picture on the canvas.

// The vertex shader of one triangle that covers all pixels.
export const OVER_ALL = `#version 300 es
void main() { gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0, 0.0, 1.0); }`;
// Add a new sample to the sums, if there are any.
export const ADD = `#version 300 es
precision highp float;
precision highp sampler2D;
uniform sampler2D sums, newSample;
uniform float hasSums;
layout(location = 0) out vec4 total;
void main() {
    ivec2 texel = ivec2(gl_FragCoord.xy);
    total = texelFetch(newSample, texel, 0);
    if (hasSums > 0.0) total += texelFetch(sums, texel, 0);
}`;

// Draw the picture on the canvas, from a film that may have fewer pixels. With `keep`, pixels off
// the asset come from `whole`, a film of the canvas's size, so that the background stays sharp. To
// the right of `wipe`, a fraction of the width, is the exact picture. With `differs`, the canvas
// shows the difference of the exact picture and the film instead.
export const PRESENT = `#version 300 es
precision highp float;
precision highp sampler2D;
uniform sampler2D film, whole, exact, sums, exact_sums;
uniform ivec2 canvas;
uniform int keep, differs;
uniform float wipe, samples, gain;
layout(location = 0) out vec4 color;
void main() {
    vec2 uv = gl_FragCoord.xy / vec2(canvas);
    ivec2 size = textureSize(film, 0);
    color = texelFetch(film, min(ivec2(uv * vec2(size)), size - 1), 0);
    if (keep == 1) {
        vec4 sharp = texelFetch(whole, ivec2(gl_FragCoord.xy), 0);
        if (sharp.a == 0.0) color = sharp;
    }
    if (uv.x >= wipe) color = texture(exact, uv);
    if (differs == 1) {
        ivec2 exact_size = textureSize(exact_sums, 0);
        ivec2 texel = min(ivec2(uv * vec2(exact_size)), exact_size - 1);
        vec4 right = texelFetch(exact_sums, texel, 0);
        vec4 left = texelFetch(sums, min(ivec2(uv * vec2(size)), size - 1), 0) / samples;
        float difference = gain * dot(right.rgb - left.rgb, vec3(1.0 / 3.0));
        vec3 grey = vec3(max(left.a, right.a) > 0.0 ? 0.25 : 0.1);
        vec3 tint = difference > 0.0 ? vec3(1.0, 0.62, 0.2) : vec3(0.2, 0.55, 1.0);
        color.rgb = mix(grey, tint, min(1.0, abs(difference)));
    }
    color.a = 1.0;
}`;
