#!/bin/sh
# Hashes the images of many kinds of frames, to compare builds: golden.sh DIPTYCH FILE
#
# Writes FILE, one line per image of every run: SHA-256, run, image. Images depend on the Vulkan driver, so compare
# files from the same driver. Anything that varies between runs of one build is excluded: rows are distributed evenly or
# as stated.
set -eu
diptych=$1
file=$2
size=${GOLDEN_SIZE:-96x54}
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
: >"$file.part"

# NAME OPTIONS...: renders, and records the hashes of all images of scene-referred light and auxiliary values.
run() {
    name=$1
    shift
    "$diptych" render "$@" --size "$size" --out "$folder/$name" --quiet >/dev/null
    (cd "$folder/$name" && find . -name '*.exr' | sort | while read -r image; do
        printf '%s  %s %s\n' "$(sha256sum <"$image" | cut -d' ' -f1)" "$name" "$image"
    done) >>"$file.part"
    rm -rf "${folder:?}/$name"
}

# The same scene read from glTF, and head motion with canted eyes.
"$diptych" export builtin:studio --out "$folder/gltf" >/dev/null
left='"position_m": [-0.032, 0, 0], "orientation": [0, 0.0436, 0, 0.999], "fov": {"left": -0.9, "right": 0.7, "up": 0.8, "down": -0.8}'
right='"position_m": [0.032, 0, 0], "orientation": [0, -0.0436, 0, 0.999], "fov": {"left": -0.7, "right": 0.9, "up": 0.8, "down": -0.8}'
head=$(dirname "$0")/../scenes/head.jsonl
{
    printf '{"diptych_motion": 1, "eyes": {"left": {%s}, "right": {%s}}}\n' "$left" "$right"
    sed 1d "$head"
} >"$folder/eyes.jsonl"

for count in 1 2 3; do
    divided="--virtual $count --threads-per-device 1 --balance even"
    for scene in cornell atrium; do
        for denoiser in none atrous svgf bmfr; do
            for frames in 1 4; do
                # shellcheck disable=SC2086
                run "$scene-$denoiser-x$frames-d$count" "builtin:$scene" $divided --denoiser "$denoiser" --frames "$frames" --warm-up 0
            done
        done
    done
    atrium="builtin:atrium $divided"
    # shellcheck disable=SC2086
    {
        run "spp3-d$count" $atrium --spp 3 --frames 2 --warm-up 0
        run "spp3-none-d$count" $atrium --spp 3 --denoiser none
        run "traced-d$count" $atrium --reproject off --frames 2 --warm-up 0
        run "scale-d$count" $atrium --set render_scale=0.6 --frames 2 --warm-up 0
        run "scale-atrous-d$count" $atrium --set render_scale=0.6 --denoiser atrous
        run "foveation-d$count" $atrium --foveation layers --gaze 0.4,0.6 --frames 2 --warm-up 0
        run "foveation-atrous-d$count" $atrium --foveation layers --denoiser atrous --spp 3
        run "iterations-d$count" $atrium --iterations 2 --frames 2 --warm-up 0
        run "recompute-d$count" $atrium --set halo=recompute --frames 2 --warm-up 0
        run "exchange-d$count" $atrium --set halo=exchange --frames 2 --warm-up 0
        run "exchange-atrous-d$count" $atrium --set halo=exchange --denoiser atrous
        run "seam-none-d$count" $atrium --seam none --frames 2 --warm-up 0
        run "seam-none-atrous-d$count" $atrium --seam none --denoiser atrous
        run "seam-filter-d$count" $atrium --seam filter --frames 2 --warm-up 0
        run "seam-filter-atrous-d$count" $atrium --seam filter --denoiser atrous
        run "aov-d$count" $atrium --aov albedo,normal,position,depth,motion,roughness,holes,spp,base_color,diffuse_albedo,specular_albedo --frames 2 --warm-up 0
        run "shown-d$count" builtin:gallery $divided --aov shown_position,shown_normal,virtual_position
        run "cached-d$count" builtin:cornell $divided --frames 24 --fps 72 --warm-up 0
        run "uncached-d$count" builtin:cornell $divided --cache off --frames 2 --warm-up 0
        run "forest-d$count" builtin:forest $divided --frames 2 --warm-up 0
        run "towers-d$count" builtin:towers $divided --frames 2 --warm-up 0
        run "checker-d$count" builtin:checker $divided --frames 2 --warm-up 0
        run "furnace-d$count" builtin:furnace $divided --frames 2 --warm-up 0
        run "visual-polar-d$count" $atrium --foveation visual-polar --gaze 0.4,0.6 --frames 2 --warm-up 0
        for mode in fov composite-kernel; do
            run "log-polar-$mode-d$count" $atrium --foveation log-polar --set polar=$mode --frames 2 --warm-up 0
        done
        run "moving-d$count" builtin:studio $divided --frames 3 --fps 8 --warm-up 0 --aov motion,last_position
        run "moving-bmfr-d$count" builtin:studio $divided --denoiser bmfr --frames 3 --fps 8 --warm-up 0
        run "head-d$count" $atrium --set motion="$head" --time 0.5 --frames 2 --warm-up 0
        run "eyes-d$count" $atrium --set motion="$folder/eyes.jsonl" --time 0.5 --frames 2 --warm-up 0 --aov motion,normal
        run "eyes-polar-d$count" $atrium --set motion="$folder/eyes.jsonl" --time 0.5 --foveation visual-polar --gaze 0.4,0.6
        run "gltf-d$count" "$folder/gltf/studio.toml" $divided --frames 2 --warm-up 0
    }
done
run "flight" builtin:cornell --virtual 2 --threads-per-device 1 --frames 4 --set frames_in_flight=2 --warm-up 0
run "static" builtin:cornell --virtual 2 --threads-per-device 1 --ratios 5,3 --frames 2 --warm-up 0
run "uneven" builtin:cornell --virtual 2 --threads-per-device 1 --ratios 1,1 --ratios atrous=3,1 --ratios tonemap=1,4 --ratios path_trace.left=2,3 --frames 3 --warm-up 0
mv "$file.part" "$file"
wc -l "$file"
