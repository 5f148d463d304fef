"""railctl study: many runs that are compared: what they will take, carrying them out, how far they are, the report."""

from railctl.deploy.verbs import Verb, group

app = group(
    "Plan, run, watch and report on studies: many runs that are compared.",
    {
        "plan": Verb(
            "railctl.deploy.commands.study.plan:plan",
            "Say how many runs and levels a study needs, and the hours and the disk, measured on its runs or without.",
        ),
        "run": Verb(
            "railctl.deploy.commands.study.run:run",
            "Train, evaluate and report on all that a study compares; "
            "killed or stopped at any time, it goes on from there.",
        ),
        "place": Verb(
            "railctl.deploy.commands.study.place:place",
            "Print a batch script that has Slurm carry out a study, as an array of jobs with a share of its runs each.",
        ),
        "status": Verb(
            "railctl.deploy.commands.study.status:status",
            "Show how many runs of each contender on each level are done, running, waiting or failed, "
            "and the time left.",
        ),
        "report": Verb(
            "railctl.deploy.commands.study.report:report",
            "Make a study's report anew, of whatever has been done of it.",
        ),
        "publish": Verb(
            "railctl.deploy.commands.study.publish:publish",
            "Keep a study's results and the report on them in a small folder, which needs no runs.",
        ),
    },
)
