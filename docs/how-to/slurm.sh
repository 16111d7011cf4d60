#!/usr/bin/env bash
# A batch script for Slurm: one run over several nodes. Copy it, change the numbers, then
#   sbatch slurm.sh [SCENE]
#SBATCH --job-name=ripstop
#SBATCH --nodes=4
#SBATCH --ntasks-per-node=32
#SBATCH --time=12:00:00
set -euo pipefail

# The MPI that Ripstop was built with (OpenMPI; it asks Slurm to start its daemons).
module load openmpi 2>/dev/null || true

# On a file system that all nodes share, as all below.
ripstop="${RIPSTOP:-$HOME/ripstop/target/release/ripstop}"
scene="${1:-$HOME/ripstop/cases/atps-descent/scene.toml}"
out="$SLURM_SUBMIT_DIR/runs/$SLURM_JOB_ID"

# This script runs on the first node, and so does ripstop: each program begins there.
mapfile -t nodes < <(scontrol show hostnames "$SLURM_JOB_NODELIST")
# `on 24 a b` is a:24,b:24
on() {
    local ranks="$1" list=()
    shift
    for node in "$@"; do list+=("$node:$ranks"); done
    local IFS=,
    printf '%s' "${list[*]}"
}

# Cores of a node: 24 for the flow, 4 for the mesh; the structure has 4 on the first.
# The programs take turns, so a node may also have more ranks than cores.
"$ripstop" run "$scene" --out "$out" \
    --ranks "structure=4,mesh=$((4 * ${#nodes[@]})),flow=$((24 * ${#nodes[@]}))" \
    --mpirun structure="--host $(on 4 "${nodes[0]}")" \
    --mpirun mesh="--host $(on 4 "${nodes[@]}")" \
    --mpirun flow="--host $(on 24 "${nodes[@]}")"
