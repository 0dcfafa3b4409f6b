// What the page was made from: a description in JSON and the numbers that it points into.

/** The bytes of a base64 text. */
function decodeBase64(text) {
  const binary = atob(text);
  const bytes = new Uint8Array(binary.length);
  for (let i = 0; i < binary.length; ++i) bytes[i] = binary.charCodeAt(i);
  return bytes;
}

const sectionTypes = {f32: Float32Array, u32: Uint32Array, f16: Uint16Array};

/**
 * The description with `section(name)`, a typed array over the page's numbers (halves as their bits), or null.
 * The texts leave the document: they are not needed twice.
 */
function readData() {
  const take = (id) => {
    const element = document.getElementById(id);
    const text = element.textContent;
    element.remove();
    return text;
  };
  const data = JSON.parse(take("description"));
  const bytes = decodeBase64(take("numbers"));
  data.section = (name) => {
    const found = data.sections[name];
    return found ? new sectionTypes[found.type](bytes.buffer, found.at, found.count) : null;
  };
  return data;
}

/** The values of all 65,536 halves (IEEE 754 binary16), by their bits. */
function halfValues() {
  const values = new Float32Array(65536);
  for (let bits = 0; bits < 32768; ++bits) {
    const exponent = bits >> 10, fraction = bits & 1023;
    let value = exponent === 0 ? fraction * 2 ** -24 : (1 + fraction / 1024) * 2 ** (exponent - 15);
    if (exponent === 31) value = fraction === 0 ? Infinity : NaN;
    values[bits] = value;
    values[bits + 32768] = -value;
  }
  return values;
}
