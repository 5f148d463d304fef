# This is the host. The folder is read by the other nodes, of the same user, and goes with the job.
rm -rf "$folder"  # of before a requeue
(umask 077 && mkdir -p "$folder")
trap 'rm -rf "$folder"' EXIT
printf '%s' "$run_file" > "$folder/run.yaml"
railctl keys create "$keys" --host "$host"

"${up[@]}" &
host_process=$!
others=$((SLURM_JOB_NUM_NODES - 1))
srun --relative=1 --nodes="$others" --ntasks="$others" --cpus-per-task="$SLURM_CPUS_PER_TASK" --kill-on-bad-exit=0 \
    "${join[@]}" &
joined=$!

code=0
until_ended "$host_process" || code=$?
kill -TERM "$joined" 2> /dev/null || true  # those that have heard of the end are gone already
wait "$joined" || true
if [ -n "$again" ] && [ "$code" -ne 0 ]; then
    scontrol requeue "$SLURM_JOB_ID"
fi
exit "$code"
