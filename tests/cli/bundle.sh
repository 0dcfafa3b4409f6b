#!/usr/bin/env bash
# bundle.sh SOURCE BUILD: makes the bundle, moves it, and solves a scene with it in an empty environment. Every library
# that it loads must be its own, glibc's, or the compiler's.
set -euo pipefail
command -v patchelf >/dev/null || { echo "skipped: patchelf is not installed"; exit 77; }
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
"$1/scripts/make-bundle.sh" "$2" "$work/made"
mkdir "$work/moved here"
tar -C "$work/moved here" -xzf "$work"/made/*.tar.gz
rm -rf "$work/made"
root=$(echo "$work/moved here"/interflect-*)

libraries() { LD_TRACE_LOADED_OBJECTS=1 "$root/bin/interflect" | sed -n 's/.* => \(.*\) (0x.*/\1/p'; }
strangers=$(libraries | grep -vF "$root/" |
  grep -vE '/(libc|libm|libdl|libpthread|librt|libstdc\+\+|libgcc_s|libgomp)\.so' || true)
loaded=$(libraries | grep -cF "$root/bin/../lib/")
[ -z "$strangers" ] || { echo "the bundle loads from outside: $strangers"; exit 1; }
[ "$loaded" -ge 10 ] || { echo "only $loaded libraries come from the bundle"; exit 1; }

# The same with the compiler's libraries of the bundle.
LD_LIBRARY_PATH="$root/lib/fallback" libraries | grep -qF "$root/lib/fallback/libstdc++.so.6" || { echo "no libstdc++ to fall back to"; exit 1; }

cd "$work"
env -i "$root/interflect" solve "$root/share/interflect/scenes/furnace.obj" --divide 0.1 --device openmp -o b.csv --quiet
# b = e / (1 - rho): 1, 2, 3 in every patch
awk -F, 'NR > 1 {for (k = 0; k < 3; ++k) {d = $(16 + k) / (k + 1) - 1; if (d > 1e-4 || d < -1e-4) bad = 1}; ++n}
  END {if (bad || n != 192) {print "the furnace is wrong"; exit 1}; print "192 patches, all right"}' b.csv
