"""Materials by the code of a segment's terminology (SNOMED CT). Assumptions to begin with, for a patient's
own values to replace: E, nu, density and relaxation time, and where each is from."""

LIVER = {"E": "5 kPa", "nu": 0.45, "density": "1060 kg/m3", "damping": "20 ms"}

# By code: the material, and its origin.
TISSUES = {
    "10200004": (LIVER, "liver: near the median of healthy transient elastography (6.6 kPa), rounded down, since "
                        "elastography measures fast shear; nu and damping are assumptions"),
    "4147007": ({**LIVER, "E": "15 kPa"}, "mass: hepatocellular carcinoma, 14.9 kPa"),
    "108369006": ({**LIVER, "E": "15 kPa"}, "neoplasm: hepatocellular carcinoma, 14.9 kPa"),
    "59820001": ({**LIVER, "E": "20 kPa"}, "blood vessel: wall and blood as one material, an assumption"),
}
UNKNOWN = (LIVER, "not known: the liver's, to be replaced")


def code_of(entry: str) -> str:
    """The code of the type in a terminology entry of 3D Slicer, "LIST~CATEGORY~TYPE~…" with parts
    "SCHEME^CODE^MEANING"; "" where there is none."""
    parts = entry.split("~")
    triple = parts[2].split("^") if len(parts) > 2 else []
    return triple[1] if len(triple) == 3 and triple[0] == "SCT" else ""


def material_of(entry: str):
    """The material of a terminology entry, and where it is from."""
    return TISSUES.get(code_of(entry), UNKNOWN)
