// @ts-check
// The renderer of the review page: it draws pictures, wipes and differences of two frames, A and B,
// on a canvas by WebGL 2, and converts them by OpenColorIO's view, which is a GLSL function.
"use strict";

review.MODES = { picture: 0, wipe: 1, difference: 2, noise: 3 };

// Return the functions `draw` and `codeValues` of a canvas, or null if the browser has no WebGL 2.
// `view` is the result of lookdev.output.review.view.view_shader.
review.createRenderer = (canvas, view) => {
  const gl = canvas.getContext("webgl2", {
    alpha: false,
    antialias: false,
    preserveDrawingBuffer: true,
  });
  if (!gl) return null;
  const MOST_FRAMES = 12; // largest number of frames with textures on the GPU
  const floatFiltering = gl.getExtension("OES_texture_float_linear");
  // The textures of colour and error by the key of their frame, the least recently used first.
  const textures = new Map();

  const vertex = `#version 300 es
    in vec2 corner;
    out vec2 uv;
    void main() {
      uv = vec2(corner.x, 1.0 - corner.y);
      gl_Position = vec4(2.0 * corner - 1.0, 0.0, 1.0);
    }`;
  const fragment = `#version 300 es
    precision highp float;
    precision highp int;
    precision highp sampler2D;
    precision highp sampler3D;
    ${view.glsl}
    uniform sampler2D pixelsA, errorA, pixelsB, errorB;
    uniform int mode, radius;
    uniform float exposure, split, amplify, behind;
    in vec2 uv;
    out vec4 color;

    vec3 displayColor(sampler2D pixels) {
      vec4 texel = texture(pixels, uv);
      vec3 light = exposure * (texel.rgb + (1.0 - texel.a) * behind);
      return clamp(view(vec4(light, 1.0)).rgb, 0.0, 1.0);
    }

    // The ratio z of a pixel, as in lookdev.metrics.noise_ratio.
    float noiseRatio() {
      ivec2 size = textureSize(pixelsA, 0), center = ivec2(uv * vec2(size));
      vec3 difference = vec3(0.0);
      float noise = 0.0;
      for (int y = max(center.y - radius, 0); y <= min(center.y + radius, size.y - 1); y++) {
        for (int x = max(center.x - radius, 0); x <= min(center.x + radius, size.x - 1); x++) {
          ivec2 texel = ivec2(x, y);
          vec3 a = texelFetch(pixelsA, texel, 0).rgb, b = texelFetch(pixelsB, texel, 0).rgb;
          float sigmaA = texelFetch(errorA, texel, 0).r, sigmaB = texelFetch(errorB, texel, 0).r;
          difference += a - b;
          noise += sigmaA * sigmaA + sigmaB * sigmaB;
          noise += (dot(a, a) + dot(b, b)) * exp2(-22.0);
        }
      }
      return noise > 0.0 ? sqrt(dot(difference, difference) / noise) : 0.0;
    }

    // The colour of z: grey up to 3, where noise explains the difference; orange to white beyond.
    vec3 noiseColor(float z) {
      if (z <= 3.0) return vec3(0.08 + 0.06 * z);
      float t = clamp((z - 3.0) / 9.0, 0.0, 1.0);
      return mix(vec3(0.85, 0.33, 0.0), mix(vec3(1.0, 0.80, 0.2), vec3(1.0), t), sqrt(t));
    }

    void main() {
      if (mode == 1)
        color = vec4(uv.x < split ? displayColor(pixelsA) : displayColor(pixelsB), 1.0);
      else if (mode == 2)
        color = vec4(0.5 + 0.5 * amplify * (displayColor(pixelsA) - displayColor(pixelsB)), 1.0);
      else if (mode == 3) color = vec4(noiseColor(noiseRatio()), 1.0);
      else color = vec4(displayColor(pixelsA), 1.0);
    }`;

  function compileShader(type, source) {
    const shader = gl.createShader(type);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS))
      throw new Error(gl.getShaderInfoLog(shader));
    return shader;
  }
  const program = gl.createProgram();
  gl.attachShader(program, compileShader(gl.VERTEX_SHADER, vertex));
  gl.attachShader(program, compileShader(gl.FRAGMENT_SHADER, fragment));
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS))
    throw new Error(gl.getProgramInfoLog(program));
  gl.useProgram(program);
  gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
  gl.bufferData(gl.ARRAY_BUFFER, new Float32Array([0, 0, 1, 0, 0, 1, 1, 1]), gl.STATIC_DRAW);
  const corner = gl.getAttribLocation(program, "corner");
  gl.enableVertexAttribArray(corner);
  gl.vertexAttribPointer(corner, 2, gl.FLOAT, false, 0, 0);
  gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
  const uniform = (name) => gl.getUniformLocation(program, name);
  ["pixelsA", "errorA", "pixelsB", "errorB"].forEach((name, unit) =>
    gl.uniform1i(uniform(name), unit),
  );

  function setFilter(target, filter) {
    for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER])
      gl.texParameteri(target, name, filter);
    for (const axis of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T, gl.TEXTURE_WRAP_R]) {
      gl.texParameteri(target, axis, gl.CLAMP_TO_EDGE);
    }
  }

  // The tables that the view reads use the texture units from 4 on. They are half floats if the
  // browser cannot interpolate float textures.
  view.textures.forEach((table, number) => {
    const bytes = Uint8Array.from(atob(table.texels), (c) => c.charCodeAt(0));
    const texels = new Float32Array(bytes.buffer);
    const target = table.size[2] > 1 ? gl.TEXTURE_3D : gl.TEXTURE_2D;
    const format = table.components === 1 ? gl.RED : gl.RGB;
    const [single, half] = table.components === 1 ? [gl.R32F, gl.R16F] : [gl.RGB32F, gl.RGB16F];
    gl.activeTexture(gl.TEXTURE0 + 4 + number);
    gl.bindTexture(target, gl.createTexture());
    const internal = floatFiltering ? single : half;
    if (target === gl.TEXTURE_3D)
      gl.texImage3D(target, 0, internal, ...table.size, 0, format, gl.FLOAT, texels);
    else
      gl.texImage2D(target, 0, internal, table.size[0], table.size[1], 0, format, gl.FLOAT, texels);
    setFilter(target, table.smooth ? gl.LINEAR : gl.NEAREST);
    gl.uniform1i(uniform(table.sampler), 4 + number);
  });

  // Return the textures of a frame's colour and error; upload them if they are not on the GPU.
  function uploadFrame(frame) {
    let pair = textures.get(frame.key);
    if (pair) {
      textures.delete(frame.key);
    } else {
      const createTexture = (internal, format, width, height, data) => {
        const texture = gl.createTexture();
        gl.activeTexture(gl.TEXTURE0);
        gl.bindTexture(gl.TEXTURE_2D, texture);
        gl.texImage2D(gl.TEXTURE_2D, 0, internal, width, height, 0, format, gl.HALF_FLOAT, data);
        setFilter(gl.TEXTURE_2D, gl.NEAREST);
        return texture;
      };
      pair = [
        createTexture(gl.RGBA16F, gl.RGBA, frame.width, frame.height, frame.rgba),
        frame.error
          ? createTexture(gl.R16F, gl.RED, frame.width, frame.height, frame.error)
          : createTexture(gl.R16F, gl.RED, 1, 1, new Uint16Array(1)),
      ];
    }
    textures.set(frame.key, pair);
    while (textures.size > MOST_FRAMES) {
      const [oldestKey, oldestPair] = textures.entries().next().value;
      oldestPair.forEach((texture) => gl.deleteTexture(texture));
      textures.delete(oldestKey);
    }
    return pair;
  }

  // Draw the frame `a`, compared with the frame `b` unless this is null. `options` are the `mode`,
  // a key of review.MODES; the exposure in `stops`; `split`, the position of the wipe as a fraction
  // of the width; `amplify`, the factor of a difference; `behind`, the grey of the background; and
  // `square`, the side in pixels of the squares over which z is computed.
  function draw(a, b, options) {
    if (canvas.width !== a.width || canvas.height !== a.height)
      [canvas.width, canvas.height] = [a.width, a.height];
    gl.viewport(0, 0, a.width, a.height);
    [...uploadFrame(a), ...uploadFrame(b || a)].forEach((texture, unit) => {
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.bindTexture(gl.TEXTURE_2D, texture);
    });
    const sameSize = b && b.width === a.width && b.height === a.height;
    const hasErrors = sameSize && a.error && b.error;
    gl.uniform1i(
      uniform("mode"),
      options.mode === "noise" ? (hasErrors ? 3 : 0) : b ? review.MODES[options.mode] : 0,
    );
    gl.uniform1i(uniform("radius"), (options.square - 1) / 2);
    gl.uniform1f(uniform("exposure"), 2 ** options.stops);
    gl.uniform1f(uniform("split"), options.split);
    gl.uniform1f(uniform("amplify"), options.amplify);
    gl.uniform1f(uniform("behind"), options.behind);
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
  }

  // Return the three code values, from 0 to 255, of a pixel of the canvas.
  function codeValues(x, y) {
    const texel = new Uint8Array(4);
    gl.readPixels(x, canvas.height - 1 - y, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, texel);
    return [...texel.subarray(0, 3)];
  }

  return { draw, codeValues };
};
