"""check_furnace.py MTL OUTPUT: every group that the example printed has b = Ke / (1 - Kd) within 1e-4."""
import sys

values = {}
for line in open(sys.argv[1], encoding="utf-8"):
    words = line.split()
    if words and words[0] in ("Kd", "Ke"):
        values[words[0]] = [float(w) for w in words[1:4]]
expected = [e / (1 - r) for e, r in zip(values["Ke"], values["Kd"])]
groups = [line.split() for line in sys.argv[2].splitlines()[1:] if line.strip()]
if not groups:
    sys.exit("no groups were printed")
for group in groups:
    for got, want in zip(map(float, group[-3:]), expected, strict=True):
        if not abs(got / want - 1) < 1e-4:
            sys.exit(f"{group}: expected {expected}")
