#!/bin/sh
# Checks for build and run-time dependencies outside Cargo: cargo itself, a C++ compiler (the crate `meshopt` contains
# C++) and, on Linux, a Vulkan loader and driver. If the loader or any driver is missing and apt-get exists, installs
# Mesa's drivers, which include a software one. Installs nothing else. Warns about an old, slow software driver.
set -eu

fail() {
    echo "deps: $*" >&2
    exit 1
}

has() {
    command -v "$1" >/dev/null 2>&1
}

# Succeeds if one of the paths in the colon-separated list $1 exists.
any_exists() {
    old_ifs=$IFS
    IFS=:
    for path in $1; do
        if [ -n "$path" ] && [ -e "$path" ]; then
            IFS=$old_ifs
            return 0
        fi
    done
    IFS=$old_ifs
    return 1
}

# Lists the JSON manifests of Vulkan drivers, one per line; the two variables replace the search.
driver_files() {
    named=${VK_DRIVER_FILES:-${VK_ICD_FILENAMES:-}}
    if [ -n "$named" ]; then
        echo "$named" | tr : '\n'
        return
    fi
    home=${HOME:-/nonexistent}
    for folder in /usr/share /usr/local/share /etc /usr/local/etc /etc/xdg /run/opengl-driver/share \
        "${XDG_CONFIG_HOME:-$home/.config}" "${XDG_DATA_HOME:-$home/.local/share}"; do
        for file in "$folder"/vulkan/icd.d/*.json; do
            if [ -e "$file" ]; then
                echo "$file"
            fi
        done
    done
}

has_driver() {
    named=${VK_DRIVER_FILES:-${VK_ICD_FILENAMES:-}}
    if [ -n "$named" ]; then
        any_exists "$named" || fail "VK_DRIVER_FILES or VK_ICD_FILENAMES names no file that exists: $named"
    fi
    [ -n "$(driver_files)" ]
}

# Prints the library of the driver manifest $1, which names it with a path or for the linker to find.
library_of() {
    name=$(sed -n 's/.*"library_path"[^"]*"\([^"]*\)".*/\1/p' "$1")
    case $name in
    /*) echo "$name" ;;
    */*) echo "$(dirname "$1")/$name" ;;
    *) ls /usr/lib/"$name" /usr/lib64/"$name" /usr/lib/*/"$name" /usr/local/lib/"$name" 2>/dev/null | head -n 1 ;;
    esac
}

# Mesa's software driver contains its version. 25 is the oldest version known to be fast.
tell_old_mesa() {
    driver_files | while read -r file; do
        case $file in
        *lvp*) ;;
        *) continue ;;
        esac
        library=$(library_of "$file")
        [ -r "$library" ] || continue
        version=$(grep -ao 'Mesa [0-9][0-9]*\.[0-9][0-9.]*' "$library" | head -n 1)
        major=${version#Mesa }
        major=${major%%.*}
        [ "${major:-25}" -lt 25 ] || continue
        echo "deps: the software Vulkan driver is of $version; frames on a CPU are 1.3 to 2.5 times as fast with Mesa 25" >&2
        if grep -qs '^VERSION_CODENAME=bookworm' /etc/os-release; then
            echo "deps: Debian 12 has it in bookworm-backports: apt-get install -t bookworm-backports mesa-vulkan-drivers" >&2
        fi
    done
}

has_loader() {
    for ldconfig in ldconfig /sbin/ldconfig /usr/sbin/ldconfig; do
        if has "$ldconfig" && "$ldconfig" -p 2>/dev/null | grep -q 'libvulkan\.so\.1'; then
            return 0
        fi
    done
    # For systems without glibc's cache.
    for file in /lib/libvulkan.so.1 /usr/lib/libvulkan.so.1 /usr/lib64/libvulkan.so.1 /usr/local/lib/libvulkan.so.1 \
        /run/opengl-driver/lib/libvulkan.so.1; do
        if [ -e "$file" ]; then
            return 0
        fi
    done
    any_exists "$(echo "${LD_LIBRARY_PATH:-}" | sed 's|\([^:]\{1,\}\)|\1/libvulkan.so.1|g')"
}

install_mesa() {
    packages="libvulkan1 mesa-vulkan-drivers"
    if ! has apt-get; then
        hint="a Vulkan loader and driver; Mesa's lavapipe is a software one"
        if has dnf; then hint="$hint: dnf install vulkan-loader mesa-vulkan-drivers"; fi
        if has pacman; then hint="$hint: pacman -S vulkan-icd-loader vulkan-swrast"; fi
        if has apk; then hint="$hint: apk add vulkan-loader mesa-vulkan-swrast"; fi
        fail "no Vulkan driver was found. Install $hint"
    fi
    as_root=
    if [ "$(id -u)" -ne 0 ]; then
        has sudo || fail "no Vulkan driver was found. As root: apt-get install $packages"
        as_root=sudo
    fi
    echo "deps: no Vulkan driver was found; installing $packages" >&2
    $as_root apt-get update
    $as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends $packages
    has_loader && has_driver || fail "$packages are installed, but there is still no Vulkan driver to be found"
}

# Uses CXX if it is set, or any compiler found.
has_cpp() {
    for compiler in ${CXX:-c++ g++ clang++}; do
        if has "$compiler"; then
            return 0
        fi
    done
    return 1
}

cargo=${CARGO:-cargo}
has "${cargo%% *}" || fail "cargo was not found. Install Rust: https://rustup.rs"

case $(uname -s) in
Linux)
    has_cpp || fail "no C++ compiler was found. Install g++ or clang (Debian or Ubuntu: apt-get install g++)"
    has_loader && has_driver || install_mesa
    tell_old_mesa
    ;;
Darwin)
    has_cpp || fail "no C++ compiler was found. Install Apple's: xcode-select --install"
    ;;
MINGW* | MSYS* | CYGWIN*)
    # Windows includes Vulkan, and Rust's installation requires the linker that comes with the compiler.
    ;;
*)
    has_cpp || fail "no C++ compiler was found. Install g++ or clang"
    has_loader && has_driver || echo "deps: no Vulkan driver was found; diptych needs one to run" >&2
    ;;
esac
