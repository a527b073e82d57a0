"""Numbers in text, all at once.

What a double holds exactly after one multiplication or division is computed here; words with more digits or greater
exponents, and words such as ``nan``, are left to the caller.
"""

from __future__ import annotations

import numpy as np

from torchrender.kernels.compile import kernel

MOST_DIGITS = 15
MOST_POWER = 22
"""Powers of ten up to which a double is exact (Clinger 1990, the fast path)."""
POWERS = 10.0 ** np.arange(MOST_POWER + 1)


@kernel()
def parse_numbers(text: np.ndarray, out: np.ndarray, hard: np.ndarray) -> tuple[int, int]:
    """Numbers between blanks of any kind.

    Args:
        text: (n,) uint8.
        out: (m,) float64 gets them; NaN where the caller has to look itself.
        hard: (m,2) int64 gets number and first byte of those.

    Returns:
        How many numbers there are and how many of them are hard; -1 numbers where there are more than m.
    """
    n, at, found, left = len(text), 0, 0, 0
    while True:
        while at < n and text[at] <= 32:
            at += 1
        if at >= n:
            return found, left
        if found >= len(out):
            return -1, left
        start = at
        negative = text[at] == 45
        if negative or text[at] == 43:
            at += 1
        mantissa, digits, point, seen = np.int64(0), 0, 0, False
        fraction = False
        while at < n:
            c = text[at]
            if 48 <= c <= 57:
                seen = True
                if digits or c != 48:
                    digits += 1
                if digits <= 18:
                    mantissa = mantissa * 10 + np.int64(c - 48)
                if fraction:
                    point += 1
            elif c == 46 and not fraction:
                fraction = True
            else:
                break
            at += 1
        power = -point
        plain = seen and digits <= MOST_DIGITS
        if plain and at < n and (text[at] == 101 or text[at] == 69):
            at += 1
            down = at < n and text[at] == 45
            if down or (at < n and text[at] == 43):
                at += 1
            exponent, any_digit = 0, False
            while at < n and 48 <= text[at] <= 57:
                any_digit = True
                if exponent < 9999:
                    exponent = exponent * 10 + int(text[at] - 48)
                at += 1
            plain = any_digit
            power += -exponent if down else exponent
        plain = plain and (at >= n or text[at] <= 32) and -MOST_POWER <= power <= MOST_POWER
        if plain:
            value = float(mantissa)
            value = value * POWERS[power] if power >= 0 else value / POWERS[-power]
            out[found] = -value if negative else value
        else:
            while at < n and text[at] > 32:
                at += 1
            out[found] = np.nan
            hard[left, 0], hard[left, 1] = found, start
            left += 1
        found += 1
