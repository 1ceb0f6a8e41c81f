// Rotations, as quaternions x, y, z, w.

/** A vector turned by a quaternion. */
export function turned([x, y, z, w], [a, b, c]) {
  const [p, q, r] = [2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a)];
  return [a + w * p + y * r - z * q, b + w * q + z * p - x * r, c + w * r + x * q - y * p];
}

/** The rotation back. */
export const inverse = ([x, y, z, w]) => [-x, -y, -z, w];
