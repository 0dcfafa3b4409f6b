#!/usr/bin/env bash
# make-bundle.sh BUILD OUT: a folder OUT/interflect-VERSION-x86_64 and its archive .tar.gz, which run on any x86-64 Linux
# with glibc 2.36 or newer: the program with the shared libraries that it needs beside it (the loaders of OpenCL and
# Vulkan too; drivers are the machine's own), the scenes, and gpu-check.sh.
set -euo pipefail
build=$(realpath "$1")
out=$(mkdir -p "$2" && realpath "$2")
source=$(realpath "$(dirname "$0")/..")

version=$("$build/bin/interflect" --version | grep -oE '[0-9]+\.[0-9]+\.[0-9]+' | head -n 1)
name=interflect-$version-x86_64
root=$out/$name
rm -rf "$root"
mkdir -p "$root/bin" "$root/lib/fallback" "$root/share/interflect/scenes"

cp "$build/bin/interflect" "$root/bin/"
# glibc is the machine's. The compiler's own libraries are too, where they are new enough: a driver that the machine
# loads into the program may need newer ones than ours. So ours stand apart, and the launcher takes them if it must.
while read -r library path; do
  case $library in
    libc.so.*|libm.so.*|libdl.so.*|libpthread.so.*|librt.so.*|ld-linux*|linux-vdso*) ;;
    libstdc++.so.*|libgcc_s.so.*|libgomp.so.*) cp -L "$path" "$root/lib/fallback/$library" ;;
    *) cp -L "$path" "$root/lib/$library" ;;
  esac
done < <(ldd "$build/bin/interflect" | awk '$2 == "=>" && $3 ~ /^\// {print $1, $3}')
missing=$(ldd "$build/bin/interflect" | grep 'not found' || true)
if [ -n "$missing" ]; then
  echo "make-bundle: a library is missing: $missing" >&2
  exit 1
fi
chmod u+w "$root"/lib/*.so* "$root"/lib/fallback/*.so*
strip --strip-unneeded "$root/bin/interflect" "$root"/lib/*.so* "$root"/lib/fallback/*.so*
patchelf --set-rpath '$ORIGIN/../lib' "$root/bin/interflect"
for library in "$root"/lib/*.so*; do patchelf --set-rpath '$ORIGIN' "$library"; done

cat > "$root/interflect" <<'LAUNCHER'
#!/bin/sh
# Starts the program; with the bundle's own compiler libraries where the machine has none or older ones.
root=$(dirname "$(readlink -f "$0")")
"$root/bin/interflect" --version >/dev/null 2>&1 ||
  export LD_LIBRARY_PATH="$root/lib/fallback${LD_LIBRARY_PATH:+:$LD_LIBRARY_PATH}"
exec "$root/bin/interflect" "$@"
LAUNCHER
cp "$source/scripts/gpu-check.sh" "$root/"
chmod +x "$root/interflect" "$root/gpu-check.sh"
cp "$source"/scenes/*.obj "$source"/scenes/*.mtl "$source"/scenes/README.md "$root/share/interflect/scenes/"
cp "$source/LICENSE" "$source/README.md" "$root/"
{
  echo "interflect $version"
  git -C "$source" describe --always --dirty --abbrev=12 2>/dev/null || echo "no commit known"
} > "$root/VERSION"

tar -C "$out" -czf "$root.tar.gz" "$name"
echo "$root: $(($(du -sb "$root" | cut -f 1) / 1024)) KiB"
# Program and libraries, and the archive that travels.
limit=$((64 * 1024 * 1024))
code=$(($(du -sb "$root/bin" | cut -f 1) + $(du -sb "$root/lib" | cut -f 1)))
archive=$(stat -c %s "$root.tar.gz")
echo "$root.tar.gz: $((archive / 1024)) KiB, program and libraries in it $((code / 1024)) KiB"
if [ "$code" -ge "$limit" ] || [ "$archive" -ge "$limit" ]; then
  echo "make-bundle: larger than 64 MiB" >&2
  exit 1
fi
