// Decoding of little-endian numbers in base64.

/** Decodes base64 to bytes. */
export function bytesOf(text) {
  const binary = atob(text);
  const bytes = new Uint8Array(binary.length);
  for (let index = 0; index < bytes.length; index++) bytes[index] = binary.charCodeAt(index);
  return bytes;
}

export const floatsOf = (text) => new Float32Array(bytesOf(text).buffer);
export const idsOf = (text) => new Uint32Array(bytesOf(text).buffer);
export const wordsOf = (text) => new Uint16Array(bytesOf(text).buffer);
