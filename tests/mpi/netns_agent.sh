#!/bin/sh
# netns_agent.sh HOST COMMAND...: what mpirun takes for rsh. HOST is the address of a network namespace that
# namespaces_test.sh has made; its name is interflect-LASTNUMBER.
host=$1
shift
exec nsenter --net="/run/netns/interflect-${host##*.}" sh -c "$*"
