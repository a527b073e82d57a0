// Depth codec pz1: inverse depth codes, predicted from left + up - upper left, zigzag, low and high bytes apart, zstd.

/** Codes (Uint16Array, row by row) of `planes`, the unpacked bytes of `width` x `height` words. */
export function undoPrediction(planes, width, height) {
  const count = width * height;
  if (planes.length !== 2 * count)
    throw new Error(`depth holds ${planes.length} bytes, ${width} x ${height} needs ${2 * count}`);
  const codes = new Uint16Array(count);
  for (let row = 0, i = 0; row < height; row++) {
    // code - upper code grows along the row by the residual: one addition instead of two neighbours.
    let step = 0;
    for (let end = i + width; i < end; i++) {
      const word = planes[i] | (planes[count + i] << 8);
      step += (word >>> 1) ^ -(word & 1);
      codes[i] = (row > 0 ? codes[i - width] : 0) + step; // stored modulo 2^16
    }
  }
  return codes;
}

/** One byte for each pixel from rows of bits, the first pixel in the highest bit; each row starts a new byte. */
export function unpackBits(packed, width, height) {
  const stride = (width + 7) >> 3;
  if (packed.length !== stride * height)
    throw new Error(`mask holds ${packed.length} bytes, ${width} x ${height} needs ${stride * height}`);
  const bits = new Uint8Array(width * height);
  for (let y = 0, i = 0; y < height; y++)
    for (let x = 0; x < width; x++, i++) bits[i] = (packed[y * stride + (x >> 3)] >> (7 - (x & 7))) & 1;
  return bits;
}
