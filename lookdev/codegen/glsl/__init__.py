"""Write looks and lights as functions of GLSL ES 3.00, the language of WebGL 2 (Khronos 2016)."""
