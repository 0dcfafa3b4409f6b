#!/bin/sh
# netns_agent.sh HOST COMMAND...: what mpirun takes for rsh. HOST is the address of a network namespace that
# namespaces_test.sh has made; its name is interflect-LASTNUMBER.
host=$1
shift
# Daemons of one host name would share their session folder.
export TMPDIR="${NETNS_FOLDERS:?}/m${host##*.}"
mkdir -p "$TMPDIR"
exec nsenter --net="/run/netns/interflect-${host##*.}" sh -c "$*"
