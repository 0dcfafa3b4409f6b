// What the graphics card does: interpolates radiosity over each patch, exposes it and applies the tone curve per pixel.

const surfaceVertex = `
attribute vec3 radiosity;
attribute float corner;
varying vec3 vRadiosity;
varying vec3 vPlace;
void main() {
  vRadiosity = radiosity;
  vPlace = vec3(corner == 0.0, corner == 1.0, corner == 2.0);
  gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
}`;

// The pixels are sRGB bytes when they leave here: nothing after it changes them.
const surfaceFragment = `
uniform float exposure;
uniform int tone;          // 0 linear, 1 filmic, 2 false colour
uniform vec3 ramp[9];
uniform vec3 over;
uniform vec2 scale;        // low and high; logarithms of them on a logarithmic scale
uniform bool logarithmic;
uniform float wire;        // width of the outlines in pixels; 0: none
varying vec3 vRadiosity;
varying vec3 vPlace;

float curve(float x) {
  if (tone == 0) return min(x, 1.0);
  x = min(x, 1.0e6);
  return min(x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14), 1.0);
}

vec3 encode(vec3 c) {
  vec3 high = 1.055 * pow(max(c, 1.0e-6), vec3(1.0 / 2.4)) - 0.055;
  return mix(high, 12.92 * c, step(c, vec3(0.0031308)));
}

vec3 photographed(vec3 b) {
  vec3 exposed = exposure * max(b, 0.0);
  float largest = max(exposed.r, max(exposed.g, exposed.b));
  return largest > 0.0 ? encode(clamp(exposed * (curve(largest) / largest), 0.0, 1.0)) : vec3(0.0);
}

vec3 falseColour(vec3 b) {
  float y = dot(b, vec3(0.2126, 0.7152, 0.0722));
  float value = logarithmic ? log(max(y, 1.0e-30)) : y;
  float t = (value - scale.x) / (scale.y - scale.x);
  if (t > 1.0001) return over;
  t = clamp(t, 0.0, 1.0) * 8.0;
  vec3 colour = ramp[0];
  for (int k = 0; k < 8; ++k) colour = mix(colour, ramp[k + 1], clamp(t - float(k), 0.0, 1.0));
  return colour;
}

void main() {
  vec3 colour = tone == 2 ? falseColour(vRadiosity) : photographed(vRadiosity);
  if (wire > 0.0) {
    vec3 near = vPlace / fwidth(vPlace);
    float line = 1.0 - smoothstep(0.0, wire, min(near.x, min(near.y, near.z)));
    float bright = dot(colour, vec3(0.3, 0.6, 0.1));
    colour = mix(colour, vec3(bright > 0.45 ? 0.0 : 1.0), 0.4 * line);
  }
  gl_FragColor = vec4(colour, 1.0);
}`;

// The patch's number as a colour, for finding out what is in view.
const patchVertex = `
attribute float patchIndex;
varying vec3 vDigits;
void main() {
  float number = patchIndex + 1.0;
  vDigits = vec3(mod(number, 256.0), mod(floor(number / 256.0), 256.0), floor(number / 65536.0));
  gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
}`;

const patchFragment = `
varying vec3 vDigits;
void main() { gl_FragColor = vec4(floor(vDigits + 0.5) / 255.0, 1.0); }`;

// The patch that was chosen: its outline, and a veil so that it is found again.
const chosenVertex = `
attribute float corner;
varying vec3 vPlace;
void main() {
  vPlace = vec3(corner == 0.0, corner == 1.0, corner == 2.0);
  gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
}`;

const chosenFragment = `
uniform vec3 colour;
varying vec3 vPlace;
void main() {
  vec3 near = vPlace / fwidth(vPlace);
  float edge = min(near.x, min(near.y, near.z));
  float line = 1.0 - smoothstep(1.5, 2.5, edge);
  gl_FragColor = vec4(mix(colour, vec3(0.0), 0.6 * smoothstep(2.0, 3.0, edge) * (1.0 - smoothstep(3.0, 4.0, edge))),
                      max(line, 0.5 * (1.0 - smoothstep(3.0, 4.0, edge))));
}`;
