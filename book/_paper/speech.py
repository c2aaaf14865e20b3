"""Formulas in one line of plain text, for those who hear them: what a picture of a formula says it shows."""

from lxml import etree

ACCENTS = {"^": "hat", "¯": "bar", "˙": "dot", "~": "tilde", "→": "vector"}
NAMES = {"∑": "sum", "∏": "product", "∇": "gradient ", "′": "'", "∣": "|", "⋅": "·", "≐": "is defined as", "∗": "*",
         "←": "becomes", "\u2061": "", "…": "...", "⋯": "...", "⋮": "..."}  # fmt: skip
SPACED = set("=<>≤≥≠≈∼∝→∈+−±×|·⊙") | {"is defined as", "becomes", "sum", "product"}


def said(mathml):
    """The text of one <math> element."""
    return " ".join(tell(etree.fromstring(mathml)).split())


def tell(node):
    kind, parts = etree.QName(node).localname, [tell(child) for child in node]
    text = (node.text or "").strip()
    match kind:
        case "mi" if len(text) > 1:
            return f" {text} "
        case "mi" | "mn":
            return text
        case "mtext":
            return f" {text} "
        case "mo":
            name = NAMES.get(text, text)
            return f" {name} " if name in SPACED or name.isalpha() else f"{name} " if name in (",", ";") else name
        case "mspace":
            return " "
        case "mfrac":
            return "/".join(map(grouped, parts))
        case "msqrt":
            return f"root of ({''.join(parts)})"
        case "msub" | "munder":
            return script(parts[0], parts[1], None)
        case "msup":
            return script(parts[0], None, parts[1])
        case "mover" if parts[1].strip() in ACCENTS:
            return f"{parts[0]}-{ACCENTS[parts[1].strip()]}"
        case "mover":
            return script(parts[0], None, parts[1])
        case "msubsup" | "munderover":
            return script(*parts)
        case "mtr":
            return " ".join(parts)
        case "mtable":
            return "; ".join(parts)
        case _:
            return "".join(parts)


def grouped(text):
    text = text.strip()
    return text if len(text) == 1 or text.isalnum() else f"({text})"


def script(base, low, high):
    """A base with its indices; sums and products say from where to where."""
    low, high = low and low.strip(), high and high.strip()
    if base.strip() in ("sum", "product"):
        limits = (f" from {low} to {high}" if high else f" over {low}") if low else ""
        return f" {base.strip()}{limits} of "
    if high and not high.strip("'"):
        base, high = base + high, None
    end = " " if len(base.strip()) > 1 and base.strip().isalpha() else ""
    return base.rstrip() + (f"_{grouped(low)}" if low else "") + (f"^{grouped(high)}" if high else "") + end
