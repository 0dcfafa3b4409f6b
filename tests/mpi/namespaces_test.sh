#!/usr/bin/env bash
# namespaces_test.sh PROGRAM SCENE: a solve on three "machines", network namespaces with addresses of their own that
# reach each other only through a bridge; mpirun starts its daemon there as it would through ssh. Exit status 77 where
# that is not possible (no root, no ip, no mpirun), unless INTERFLECT_TEST_REQUIRE names netns.
set -euo pipefail
program=$1
scene=$2
here=$(cd "$(dirname "$0")" && pwd)

skip() {
  case ",${INTERFLECT_TEST_REQUIRE:-}," in *,netns,*) echo "FAILED: $1"; exit 1 ;; esac
  echo "SKIPPED: $1"
  exit 77
}
command -v mpirun >/dev/null || skip "mpirun is not installed"
command -v ip >/dev/null || skip "ip is not installed"
[ "$(id -u)" -eq 0 ] || skip "network namespaces need root"
"$program" devices | grep -q 'ranks (MPI)  built in' || skip "the program is built without MPI"

net=10.213.47
bridge=interflect-br
work=$(mktemp -d)
clean() {
  for k in 1 2 3; do ip netns del "interflect-$k" 2>/dev/null || true; done
  ip link del "$bridge" 2>/dev/null || true
  rm -rf "$work"
}
trap clean EXIT
# `ip -n` and `ip netns exec` remount the root, which a chroot refuses.
within() {
  local number=$1
  shift
  nsenter --net="/run/netns/interflect-$number" "$@"
}
ip netns add interflect-1 2>"$work/why" || skip "no network namespaces here: $(cat "$work/why")"
ip link add "$bridge" type bridge 2>"$work/why" || skip "no bridge here: $(cat "$work/why")"
ip addr add "$net.254/24" dev "$bridge"
ip link set "$bridge" up
for k in 1 2 3; do
  [ "$k" -eq 1 ] || ip netns add "interflect-$k"
  ip link add "interflect-v$k" type veth peer name eth0 netns "interflect-$k" 2>"$work/why" ||
    skip "no veth here: $(cat "$work/why")"
  ip link set "interflect-v$k" master "$bridge" up
  within "$k" ip addr add "$net.$k/24" dev eth0
  within "$k" ip link set eth0 up
  within "$k" ip link set lo up
done

export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1 OMP_NUM_THREADS=1 OMP_WAIT_POLICY=passive NETNS_FOLDERS=$work
solve=("$program" solve "$scene" --patches 500 --device openmp --quiet)
"${solve[@]}" -o "$work/one.npy"
# Only TCP between them: they share no memory, as machines do not.
timeout 100 mpirun --host "$net.1:1,$net.2:2,$net.3:1" -n 4 --mca plm_rsh_agent "$here/netns_agent.sh" \
  --mca btl tcp,self --mca btl_tcp_if_include "$net.0/24" --mca oob_tcp_if_include "$net.0/24" \
  --mca orte_keep_fqdn_hostnames 1 -x OMP_NUM_THREADS -x OMP_WAIT_POLICY \
  "${solve[@]}" -o "$work/four.npy" --report "$work/four.json"
cmp "$work/one.npy" "$work/four.npy"
grep -q '"count": 4' "$work/four.json"
echo "ok: four ranks in three network namespaces"
