#!/usr/bin/env bash
# Runs a campaign on a Slurm of one node and on this machine directly, and compares all results:
#   tests/slurm/run.sh FOLDER [CONFIGURATION [TARGET ...]]
# FOLDER is new and receives everything; the small configuration by default. See README.md here.
set -o errexit -o nounset -o pipefail

readonly folder=$(realpath -m "$1")
readonly configuration=$(realpath "${2:-config/quick.yaml}")
readonly targets=("${@:3}")
root=$(cd -- "$(dirname -- "${BASH_SOURCE[0]}")/../.." && pwd)
readonly root

mkdir "$folder"
trap '"$root/tests/slurm/cluster.sh" stop "$folder/cluster"' EXIT
"$root/tests/slurm/cluster.sh" start "$folder/cluster"
for place in slurm local; do
    mkdir "$folder/$place"
    cp -r "$root"/{Snakefile,workflow,config,profiles} "$folder/$place"
done

cd "$folder/slurm"
time snakemake --profile profiles/slurm --slurm-no-account --slurm-status-command squeue \
    --slurm-init-seconds-before-status-checks 5 --seconds-between-status-checks 5 \
    --configfile "$configuration" --config results=results/compared -- "${targets[@]}" 2>&1 | tee "$folder/slurm.txt"
cd "$folder/local"
time snakemake --cores "$(nproc)" --configfile "$configuration" \
    --config results=results/compared -- "${targets[@]}" 2>&1 | tee "$folder/local.txt"
cd "$root"
python tests/slurm/compare.py "$folder"/{slurm,local}/results/compared
