#!/usr/bin/env bash
#
# How much faster is a whole render than by the traversal that the program began with?
#
#   benches/peers/first.sh [-n RUNS] SCENE… [-- RENDER OPTIONS]
#
# The last commit that walked obvhs's binary tree, one ray and one triangle at a time, is checked out into a temporary
# folder and built beside the working tree. Both programs render each scene in turn, RUNS times (5), with the same options
# (--size 640x360 --spp 16) on all threads. Printed are the medians of seconds.render, which has neither loading nor
# building trees in it, the median and the range of the ratios run by run, and how far the pictures are apart: relMSE
# without the worst 0.1 % of pixels, which is noise and falls with --spp.
#
# Scenes large enough to be worth it can be had by formula; files without a camera, such as Sponza, get one:
#
#   wavecast bench accel hall --write-scenes DIR
#   wavecast bench accel Sponza.glb --view=-9,1.5,0,0,3,0 --write-scenes DIR
#   benches/peers/first.sh DIR/*.glb

set -euo pipefail

readonly LAST_WITH_BVH2=3a96aa2c452771c75e1b6965a5c5da20df73237a

usage() {
    sed -n '5s/^# *//p' "$0" >&2
    exit 2
}

runs=5
scenes=()
options=(--size 640x360 --spp 16)
while (($#)); do
    case $1 in
        -n)
            [[ ${2-} =~ ^[1-9][0-9]*$ ]] || usage
            runs=$2
            shift
            ;;
        --)
            shift
            (($#)) && options=("$@")
            break
            ;;
        -*) usage ;;
        *) scenes+=("$(realpath -e -- "$1")") ;;
    esac
    shift
done
((${#scenes[@]})) || usage

here=$(git -C "$(dirname -- "${BASH_SOURCE[0]}")" rev-parse --show-toplevel)
folder=$(mktemp -d)

remove() {
    git -C "$here" worktree remove --force "$folder/first" 2>/dev/null || true
    rm -rf -- "$folder"
    git -C "$here" worktree prune
}
trap remove EXIT
trap 'exit 130' INT
trap 'exit 143' TERM

# A program is built where its sources are, since that is where cargo finds its settings.
build() {
    echo "building $1" >&2
    (cd "$1" && CARGO_TARGET_DIR=$1/target cargo build --release --locked --bin wavecast)
}

# Seconds that a program takes to render a scene into NAME.exr, by its own clock.
render() {
    local program=$1 scene=$2 name=$3
    "$program/target/release/wavecast" render "$scene" -o "$folder/$name.exr" --stats "$folder/$name.json" \
        --quiet "${options[@]}" >/dev/null
    sed -n 's/^ *"render": *\([0-9.eE+-]*\),*$/\1/p' "$folder/$name.json"
}

# Median, least and greatest of the numbers on stdin.
spread() {
    sort -g | awk '{ x[NR] = $1 } END { print x[int((NR + 1) / 2)], x[1], x[NR] }'
}

git -C "$here" worktree add --quiet --detach "$folder/first" "$LAST_WITH_BVH2"
build "$folder/first"
build "$here"

echo "${options[*]}; $runs runs in turn; $(nproc) threads; $(git -C "$here" describe --always --dirty) over ${LAST_WITH_BVH2:0:7}"
printf '%-24s %10s %10s %22s %12s\n' scene 'first s' 'now s' 'times as fast' 'relMSE'
for scene in "${scenes[@]}"; do
    : >"$folder/times"
    for ((run = 0; run < runs; run++)); do
        first=$(render "$folder/first" "$scene" first)
        now=$(render "$here" "$scene" now)
        echo "$first $now" >>"$folder/times"
    done
    read -r first _ < <(awk '{ print $1 }' "$folder/times" | spread)
    read -r now _ < <(awk '{ print $2 }' "$folder/times" | spread)
    read -r ratio least most < <(awk '{ print $1 / $2 }' "$folder/times" | spread)
    apart=$("$here/target/release/wavecast" compare --json "$folder/first.exr" "$folder/now.exr" |
        sed -n 's/^ *"relmse_trimmed": *\([0-9.eE+-]*\),*$/\1/p')
    LC_ALL=C printf '%-24s %10.3f %10.3f %8.2f (%5.2f–%5.2f) %12.2e\n' \
        "$(basename -- "$scene")" "$first" "$now" "$ratio" "$least" "$most" "$apart"
done
