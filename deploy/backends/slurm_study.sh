"${work[@]}" &
code=0
until_ended "$!" || code=$?
if [ -n "$again" ]; then
    scontrol requeue "$SLURM_JOB_ID"
fi
exit "$code"
