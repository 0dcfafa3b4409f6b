#!/usr/bin/env bash
# gpu-check.sh [OUT]: what this machine's devices are worth, on one page. Lists them, runs every kernel of every backend
# against the fp64 reference, then the benchmark, and prints one table: device, driver, backend, kernel, error over
# bound, GB/s, share of the device's measured copy bandwidth. Everything goes to OUT (default: ./gpu-check) as well.
# Environment: INTERFLECT (the program), DEVICES (ids, default: all that are available), ROOMS (default: all four, the
# two small ones for a quick run: "1312 3360"), REPETITIONS (default: 15).
# Exit status: 0 when every device passed, 4 when one did not.
set -uo pipefail
here=$(dirname "$(readlink -f "$0")")
out=${1:-gpu-check}
mkdir -p "$out"
out=$(realpath "$out")

program=${INTERFLECT:-}
for candidate in "$here/interflect" "$here"/../build/bundle/interflect-*-x86_64/interflect "$here/../build/release/bin/interflect"; do
  [ -n "$program" ] || { [ -x "$candidate" ] && program=$candidate; }
done
[ -n "$program" ] || { echo "gpu-check: no program; set INTERFLECT, or run make bundle" >&2; exit 2; }

# A container often has NVIDIA's libraries but not the files that tell the loaders of them.
libraries=$(ldconfig -p 2>/dev/null)
has_library() { case $libraries in *"$1"*) true ;; *) false ;; esac; }
if has_library libnvidia-opencl.so.1 && ! grep -qs nvidia /etc/OpenCL/vendors/*.icd; then
  mkdir -p "$out/vendors"
  cp /etc/OpenCL/vendors/*.icd "$out/vendors/" 2>/dev/null
  echo libnvidia-opencl.so.1 > "$out/vendors/nvidia.icd"
  export OCL_ICD_VENDORS="$out/vendors/"
fi
if ! ls /usr/share/vulkan/icd.d/*nvidia* /etc/vulkan/icd.d/*nvidia* >/dev/null 2>&1; then
  for library in libGLX_nvidia.so.0 libEGL_nvidia.so.0; do
    has_library "$library" || continue
    printf '{"file_format_version": "1.0.0", "ICD": {"library_path": "%s", "api_version": "1.3.0"}}\n' "$library" \
      > "$out/nvidia_icd.json"
    others=$(ls /usr/share/vulkan/icd.d/*.json /etc/vulkan/icd.d/*.json 2>/dev/null | tr '\n' ':')
    export VK_ICD_FILENAMES="$out/nvidia_icd.json${others:+:${others%:}}"
    break
  done
fi

"$program" devices --selftest | tee "$out/devices.txt"
"$program" devices --json > "$out/devices.json"
devices=${DEVICES:-$(awk '/"id":/ {gsub(/[",]/, "", $2); id = $2} /"available": true/ {print id}' "$out/devices.json")}
status=0
grep -q 'FAIL' "$out/devices.txt" && status=4

echo
: > "$out/check.txt"
for device in $devices; do
  "$program" check --device "$device" > "$out/check.part" 2>&1 || status=4
  cat "$out/check.part" >> "$out/check.txt"
  echo "check $device: $(tail -n 1 "$out/check.part")"
done
rm -f "$out/check.part"
grep ' fail' "$out/check.txt" | head -n 20

echo
ids=$(echo $devices | tr ' ' ',')
rooms=()
for room in ${ROOMS:-}; do rooms+=(--room "$room"); done
"$program" bench --device "$ids" "${rooms[@]}" --repetitions "${REPETITIONS:-15}" --csv "$out/bench.csv" \
  --json "$out/bench.json" --quiet | tee "$out/bench.txt" || status=4

if command -v compute-sanitizer >/dev/null && [[ $devices == *cuda* ]]; then
  for tool in memcheck racecheck; do
    echo
    echo "compute-sanitizer --tool $tool"
    compute-sanitizer --tool "$tool" --error-exitcode 9 "$program" check --device cuda:0 --max-size 257 \
      > "$out/$tool.txt" 2>&1 || status=4
    tail -n 2 "$out/$tool.txt"
  done
fi

# One line per device and kernel: the worst error as a share of its bound, and the rate of the largest room measured.
{
  [ -f "$here/VERSION" ] && tr '\n' ' ' < "$here/VERSION"
  echo "$(date -u +%Y-%m-%d), $(uname -srm)"
  echo
  awk -v FS=, '
    FILENAME == ARGV[1] {
      n = split($0, field, /[ \t]+/)
      for (i = 3; i <= n; ++i) if (field[i] == "of") break
      if (i > n) next
      device = field[1]; kernel = field[2]; key = device SUBSEP kernel
      cases[key]++
      if (field[i + 2] ~ /^fail/) failed[key]++
      if (field[i + 2] ~ /^unsupported/) unsupported[key]++
      share = field[i + 1] > 0 ? field[i - 1] / field[i + 1] : field[i - 1]
      if (field[i - 1] ~ /nan/) share = 9
      if (share > worst[key]) worst[key] = share
      if (!(key in seen)) { order[++count] = key; seen[key] = 1 }
      next
    }
    FILENAME == ARGV[2] {
      if (/"id":/) { id = value($0) }
      if (/"name":/) name[id] = value($0)
      if (/"driver":/) driver[id] = value($0)
      next
    }
    FNR > 1 {  # device,what,scene,storage,n,columns,seconds,min,max,bytes,gb_per_s,...
      if ($2 == "copy") copy[$1] = $11
      rate[$1, $2] = $11
    }
    function value(line) { sub(/^[^:]*: *"/, "", line); sub(/",?$/, "", line); return line }
    END {
      line = "%-10s  %-40s  %-44s  %-16s  %12s  %7s  %9s  %8s\n"
      printf line, "id", "device", "driver", "kernel", "error/bound", "cases", "GB/s", "of copy"
      for (k = 1; k <= count; ++k) {
        split(order[k], part, SUBSEP)
        d = part[1]; kernel = part[2]
        speed = ((d, kernel) in rate) ? sprintf("%.1f", rate[d, kernel]) : "-"
        share = ((d, kernel) in rate) && copy[d] > 0 ? sprintf("%.2f", rate[d, kernel] / copy[d]) : "-"
        verdict = failed[order[k]] ? failed[order[k]] " FAIL" : cases[order[k]]
        if (unsupported[order[k]]) verdict = verdict " (" unsupported[order[k]] " n/s)"
        printf line, d, substr(name[d], 1, 40), substr(driver[d], 1, 44), kernel, sprintf("%.3f", worst[order[k]]), verdict, speed, share
      }
    }' "$out/check.txt" "$out/devices.json" "$out/bench.csv"
} | tee "$out/table.txt"
echo
[ "$status" -eq 0 ] && echo "every device passed" || echo "NOT every device passed"
exit "$status"
