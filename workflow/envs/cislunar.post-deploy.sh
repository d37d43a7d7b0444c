#!/usr/bin/env bash
# Snakemake runs this in the new environment, from the folder it was started in.
set -o errexit -o nounset -o pipefail
python -m pip install --requirement environment.txt
