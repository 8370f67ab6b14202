#!/usr/bin/env bash
# Submits a clip to Slurm: track, render in parts, join. Each job waits for the one before.
#   ./submit.sh street.mp4 ad.mp4 "476,128 759,122 759,480 482,476" out.mp4 [frames a part]
set -euo pipefail
video=$1 ad=$2 quad=$3 output=$4 size=${5:-500}

frames=$(ar-track "$video" --quad "$quad" -o "$output.track.json" --overwrite --dry-run --json |
    sed 's/.*"frames": \([0-9]*\).*/\1/')
parts=$(((frames + size - 1) / size))
mkdir -p "$output.parts"
export video ad output size

# The commands' text goes to the nodes as it is; they fill in the variables, which sbatch takes along.
track=$(quad=$quad sbatch --parsable --export=ALL --job-name=ar-track --requeue --wrap \
    'exec ar-track "$video" --quad "$quad" -o "$output.track.json" --overwrite')
render=$(sbatch --parsable --export=ALL --job-name=ar-render --requeue --dependency="afterok:$track" \
    --array="0-$((parts - 1))" --wrap '
    first=$((SLURM_ARRAY_TASK_ID * size))
    exec ar-replace "$video" "$ad" --track "$output.track.json" --frames "$first-$((first + size - 1))" \
        -o "$output.parts/$(printf %05d "$SLURM_ARRAY_TASK_ID").${output##*.}" --overwrite')
sbatch --parsable --export=ALL --job-name=ar-join --dependency="afterok:$render" --wrap \
    'ar-join "$video" "$output.parts"/* -o "$output" --overwrite && rm -r "$output.parts"'
