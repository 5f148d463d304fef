set -euo pipefail

# Waits for the process that matters. Its end is clean on SIGTERM, and also shortly before the time limit (SIGUSR1), but
# then the job goes back into the queue, and goes on.
again=
until_ended() {
    local work=$1 code
    trap 'kill -TERM '"$work"' || true' TERM
    trap 'again=yes; kill -TERM '"$work"' || true' USR1
    while code=0; wait "$work" || code=$?; kill -0 "$work" 2> /dev/null; do :; done  # a signal ends a wait
    code=0; wait "$work" || code=$?
    trap - TERM USR1
    return "$code"
}
