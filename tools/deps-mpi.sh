#!/bin/sh
# Checks for the dependencies of the feature `mpi`: OpenMPI or MPICH with its compiler driver, and libclang, which reads
# its headers. If one is missing and apt-get exists, installs it.
set -eu

# libclang-cpp, which comes with some drivers, is another library.
has_libclang() {
    [ -z "${LIBCLANG_PATH:-}" ] || return 0
    for folder in /usr/lib/*/ /usr/lib/llvm-*/lib/; do
        for file in "$folder"libclang.so* "$folder"libclang-[0-9]*.so*; do
            [ ! -e "$file" ] || return 0
        done
    done
    return 1
}

if command -v mpirun >/dev/null 2>&1 && command -v mpicc >/dev/null 2>&1 && has_libclang; then
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
