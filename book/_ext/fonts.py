"""Make the site's fonts in book/_static/fonts anew, after a page has come to use a character that they lack.

python book/_ext/fonts.py SERIF SERIF-ITALIC SANS MONO    (needs the packages fonttools and brotli)

The four are Adobe's variable TrueType files SourceSerifVariable-Roman, SourceSerifVariable-Italic,
SourceSansVariable-Roman and SourceCodeVF-Upright, under the licence in book/_static/fonts/OFL.txt. It reserves the name
"Source" for the originals, so what is cut down here has another.
"""

import io
import sys
from pathlib import Path

from fontTools import subset
from fontTools.ttLib import TTFont
from fontTools.varLib import instancer

FONTS = Path(__file__).parents[1] / "_static" / "fonts"
NAMES = {
    "serif": "Companion Serif",
    "serif-italic": "Companion Serif",
    "sans": "Companion Sans",
    "mono": "Companion Mono",
}
CHARACTERS = [
    *range(0x20, 0x7F), *range(0xA0, 0x180), *range(0x391, 0x3CA),  # Latin with accents, Greek
    *range(0x2010, 0x2027), 0x2032, 0x2033, 0x2070, 0x2074, *range(0x207F, 0x208F), 0x20AC, 0x200B,  # points, indices
    *range(0x2190, 0x2194), 0x2202, 0x2206, 0x220F, 0x2211, 0x2212, 0x221A, 0x221E, 0x222B, 0x2248, 0x2260, 0x2264,
    0x2265, 0x25A0, 0x25B2, 0x25B6, 0x25BC, 0x25C0, 0x25C6, 0x25C9, 0x25CB, 0x25CF, 0x2713, 0x2717,  # arrows, signs
]  # fmt: skip
FEATURES = ["kern", "liga", "calt", "ccmp", "locl", "mark", "mkmk", "lnum", "pnum", "tnum"]


def cut(source, name):
    """One face with the weights 400 to 700 and the characters above, as woff2."""
    font = TTFont(source)
    options = subset.Options(layout_features=FEATURES, name_IDs=[0, 13, 14], notdef_outline=True)
    worker = subset.Subsetter(options)
    worker.populate(unicodes=CHARACTERS)
    worker.subset(font)
    whole = io.BytesIO()
    font.save(whole)
    font = instancer.instantiateVariableFont(TTFont(whole), {"wght": (400, 400, 700)})
    style = "Italic" if name.endswith("italic") else "Regular"
    for number, text in {
        1: NAMES[name],
        2: style,
        4: f"{NAMES[name]} {style}",
        6: NAMES[name].replace(" ", ""),
    }.items():
        font["name"].setName(text, number, 3, 1, 0x409)
    font.flavor = "woff2"
    font.save(FONTS / f"{name}.woff2")


if __name__ == "__main__":
    for source, name in zip(sys.argv[1:], NAMES, strict=True):
        cut(source, name)
