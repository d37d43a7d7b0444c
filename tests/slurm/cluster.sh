#!/usr/bin/env bash
# A Slurm cluster of one node, this machine, without systemd, cgroups or accounting:
#   tests/slurm/cluster.sh start FOLDER
#   tests/slurm/cluster.sh stop FOLDER
# Everything it writes is in FOLDER, but for a link at /etc/slurm/slurm.conf, where none may be yet.
# Needs root and Debian's packages munge, slurmctld, slurmd and slurm-client.
set -o errexit -o nounset -o pipefail

readonly action=$1 folder=$2
node=$(hostname -s)
readonly node
readonly installed=/etc/slurm/slurm.conf

start() {
    mkdir -p "$folder"/{state,spool,log}
    chmod 700 "$folder"
    head -c 128 /dev/urandom >"$folder/munge.key"
    chmod 600 "$folder/munge.key"
    munged --force --key-file="$folder/munge.key" --socket="$folder/munge.socket" \
        --pid-file="$folder/munged.pid" --seed-file="$folder/munge.seed" \
        --log-file="$folder/log/munged.log"
    local memory_mb
    memory_mb=$(awk '/MemAvailable/ { printf "%d", $2 / 1024 * 0.8 }' /proc/meminfo)
    cat >"$folder/slurm.conf" <<CONF
ClusterName=one
SlurmctldHost=$node
AuthType=auth/munge
AuthInfo=socket=$folder/munge.socket
CredType=cred/munge
SlurmUser=root
SlurmdUser=root
SlurmctldPort=16817
SlurmdPort=16818
StateSaveLocation=$folder/state
SlurmdSpoolDir=$folder/spool
SlurmctldPidFile=$folder/slurmctld.pid
SlurmdPidFile=$folder/slurmd.pid
SlurmctldLogFile=$folder/log/slurmctld.log
SlurmdLogFile=$folder/log/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU_Memory
MpiDefault=none
ReturnToService=2
MinJobAge=3600
NodeName=$node CPUs=$(nproc) RealMemory=$memory_mb State=UNKNOWN
PartitionName=all Nodes=ALL Default=YES MaxTime=INFINITE State=UP
CONF
    # Jobs do not inherit SLURM_CONF and look here.
    if [[ -e $installed && ! $installed -ef $folder/slurm.conf ]]; then
        echo "$installed is there already: this machine has a Slurm of its own" >&2
        exit 1
    fi
    ln -s "$folder/slurm.conf" "$installed"
    slurmctld
    slurmd
    for _ in $(seq 60); do
        if sinfo --noheader --format=%t 2>/dev/null | grep -q '^idle$'; then
            return
        fi
        sleep 1
    done
    echo "the node did not come up; see $folder/log" >&2
    exit 1
}

stop() {
    for name in slurmd slurmctld munged; do
        if [[ -s $folder/$name.pid ]]; then
            kill "$(<"$folder/$name.pid")" 2>/dev/null || true
        fi
    done
    if [[ $installed -ef $folder/slurm.conf ]]; then
        rm "$installed"
    fi
}

case $action in
start | stop) "$action" ;;
*)
    echo "usage: $0 start|stop FOLDER" >&2
    exit 2
    ;;
esac
