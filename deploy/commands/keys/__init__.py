"""railctl keys: by what the machines of a run know each other."""

from railctl.deploy.verbs import Verb, group

app = group(
    "Make the keys by which the machines of a run know each other.",
    {
        "create": Verb(
            "railctl.deploy.commands.keys.create:create_keys",
            "Make an authority and a certificate for each role: host, actor, reader, operator, maybe relay.",
        ),
    },
)
