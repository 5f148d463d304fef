"""railctl levels: the bank of generated levels, pictures, recordings, and levels from and for flatland-rl."""

from railctl.deploy.verbs import Verb, group

app = group(
    "List, build, show, verify, import and export levels.",
    {
        "list": Verb(
            "railctl.deploy.commands.levels.list:list_",
            "List the levels that runs can be given: those that ship, and those of a run file.",
        ),
        "build": Verb(
            "railctl.deploy.commands.levels.build:build",
            "Generate levels ahead of time, for all runs; goes on where an earlier build was stopped.",
        ),
        "verify": Verb(
            "railctl.deploy.commands.levels.verify:verify",
            "Check the bank, or replay the recorded episodes of a file under the rules of flatland 2.2.2.",
        ),
        "show": Verb(
            "railctl.deploy.commands.levels.show:show",
            "Draw a level: rails, trains with their headings, targets and shortest ways.",
        ),
        "import": Verb(
            "railctl.deploy.commands.levels.exchange:import_",
            "Gather levels of flatland-rl's files or .npz files in one .npz file.",
        ),
        "export": Verb(
            "railctl.deploy.commands.levels.exchange:export",
            "Write levels to a file, for other programs or for flatland-rl's own tools.",
        ),
    },
)
