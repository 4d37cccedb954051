#!/bin/sh
# Checks for the dependencies of the feature `mpi`: OpenMPI or MPICH with its compiler driver, and libclang, which reads
# its headers. If one is missing and apt-get exists, installs it.
set -eu

if command -v mpirun >/dev/null 2>&1 && command -v mpicc >/dev/null 2>&1 &&
    { [ -n "${LIBCLANG_PATH:-}" ] || ls /usr/lib/*/libclang*.so* /usr/lib/llvm-*/lib/libclang*.so* >/dev/null 2>&1; }; then
    exit 0
fi
if ! command -v apt-get >/dev/null 2>&1; then
    echo "deps: install OpenMPI or MPICH with its headers, and libclang" >&2
    exit 1
fi
run=
[ "$(id -u)" = 0 ] || run=sudo
$run apt-get update
$run env DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends libopenmpi-dev openmpi-bin libclang-dev
