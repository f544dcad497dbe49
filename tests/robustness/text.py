"""Ways to spoil any text, and ways to write a number."""

from __future__ import annotations

from random import Random

__all__ = ["BAD_NUMBERS", "bad_number", "broken_text", "misspelt", "same_number"]

#: texts that Python's own conversions take for numbers, or people write for them, by what is wrong
BAD_NUMBERS = {
    "not a number": ("nan", "NaN", "-nan", "+NAN"),
    "infinite": ("inf", "-inf", "Infinity", "1e999", "-1e400"),
    "too large": ("1e18", "-1e300", "9e200", "123456789012345678901234567890"),
    "digits in groups": ("1_000", "12_3.5", "1'000", "1 000"),
    "other digits": ("\u0661\u0662", "\uff11\uff12.5", "\u0967", "1\u06f0"),
    "decimal comma": ("1,5", "-0,25", "3,0e2"),
    "unit": ("4.5 m", "12px", "3s", "1.2km"),
    "hexadecimal": ("0x1F", "0b101", "1p3"),
    "words": ("four", "none", "N/A", "-", "#REF!", "true"),
    "empty": ("", "  "),
    "two points": ("1.2.3", "1..2", ".", "1e", "--1", "+-2"),
}


def bad_number(rng: Random, without: str = "") -> tuple[str, str]:
    """Return what is wrong and a text that is no number; none that holds a character of ``without``."""
    while True:
        label = rng.choice(sorted(BAD_NUMBERS))
        text = rng.choice(BAD_NUMBERS[label])
        if not any(c in text for c in without):
            return label, text


def same_number(rng: Random, value: float) -> str:
    """Write a number in another way that reads back as the same one."""
    plain = repr(float(value))
    ways = [plain, f"+{plain}" if value >= 0 else plain, f"{value:.17e}", f"{value:.17E}"]
    if value == int(value) and abs(value) < 1e6:
        ways += [str(int(value)), f"{int(value)}.", f"{int(value)}.000", f"{int(value)}e0"]
    if "e" not in plain:
        ways += [plain + "0" if "." in plain else plain + ".0"]
        ways += [plain.replace("0.", ".", 1)] if plain.startswith("0.") and len(plain) > 3 else []
    written = rng.choice(ways)
    assert float(written) == value, (written, value)
    return written


def misspelt(rng: Random, word: str, known: frozenset[str] | set[str] = frozenset()) -> str:
    """Return the word with one slip of the pen: a letter lost, doubled, exchanged or replaced."""
    while True:
        k = rng.randrange(len(word) - 1)
        slips = (
            word[:k] + word[k + 1 :],
            word[:k] + word[k] + word[k:],
            word[:k] + word[k + 1] + word[k] + word[k + 2 :],
            word[:k] + rng.choice("abcdefghijklmnopqrstuvwxyz") + word[k + 1 :],
        )
        slip = rng.choice(slips)
        if slip != word and slip and slip not in known and slip.isidentifier():
            return slip


def broken_text(rng: Random, text: str, least: float = 0.0, most: float = 0.6) -> tuple[str, bytes]:
    """Return what was done and bytes that are no text of the format any more; cut between two shares of its length."""
    data = text.encode()
    at = rng.randrange(len(data))
    ways = {
        "not UTF-8": data[:at] + rng.choice((b"\xff", b"\xc3\x28", b"\x80", b"\xed\xa0\x80")) + data[at:],
        "zero byte": data[:at] + b"\0" + data[at:],
        "UTF-16": text.encode(rng.choice(("utf-16", "utf-16-le", "utf-16-be", "utf-32"))),
        "empty": rng.choice((b"", b"\n", b"   \n\t\n", b"\xef\xbb\xbf")),
        "noise": rng.randbytes(rng.randrange(1, 4000)) + b"\xff",
        "another format": rng.choice(
            (b"%PDF-1.4\n\xff", b"\x89PNG\r\n\x1a\n\0", b"PK\x03\x04\xff\xfe", b"\x1f\x8b\x08\0")
        ),
        "cut short": data[: int(len(data) * rng.uniform(least, most))],
    }
    label = rng.choice(sorted(ways))
    return label, ways[label]
