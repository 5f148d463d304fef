"""The settings of Zenoh sessions: how processes are linked on one machine and over several, and who may do what."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from railctl.common.tls import Credentials, FarRole, common_name
from railctl.common.wire.keys import ALL_ALIVE, ROOT, absolute
from railctl.common.wire.rights import BEHIND_A_RELAY, RIGHTS, Rights

LEASE_MS = 2000  # a silent peer's tokens vanish after this
# Who sends waits so long for room for one message, then ends the link, and all that is queued is lost. Zenoh's default,
# 5 s, is too little for who is suspended for a moment.
WAIT_MS = 30_000
# A router has everybody else wait meanwhile: who is far away, asks for much and reads nothing would have a whole run
# stand still. Where it waited for longer than the lease the others were seen to lose their links as well.
WAIT_AT_A_DOOR_MS = 1000
NO_TIMEOUT_MS = -1
EVERYTHING = (
    "put",
    "delete",
    "declare_subscriber",
    "query",
    "reply",
    "declare_queryable",
    "liveliness_token",
    "liveliness_query",
    "declare_liveliness_subscriber",
)

Plain = dict[str, Any]


@dataclass(frozen=True)
class Door:
    """Where a router lets other machines in: `listen` is an address of TLS, the credentials are those of its host."""

    listen: str
    namespace: str
    credentials: Credentials


def client(endpoint: str, connect_timeout_s: float | None, credentials: Credentials | None) -> Plain:
    """Of a session that is linked to the router at `endpoint`, and to it again whenever the link is lost."""
    link = {} if credentials is None else _tls(credentials, "connect")
    return {"mode": "client", "connect": _connect(endpoint, connect_timeout_s), **_common(link, WAIT_MS)}


def router(endpoint: str, door: Door | None) -> Plain:
    """Of a session that links all others: those of its own user at `endpoint`, and other machines at the door."""
    if door is None:
        return {"mode": "router", "listen": _listen(endpoint), **_common({}, WAIT_MS)}
    return {
        "mode": "router",
        "listen": _listen(endpoint, door.listen),
        "access_control": access_control(door.namespace),
        **_common(_tls(door.credentials, "listen"), WAIT_AT_A_DOOR_MS),
    }


def relay(listen: str, host: str, credentials: Credentials) -> Plain:
    """Of a session that links other machines, at `listen`, to the host of a run, and again whenever that link is lost.

    It does not know the run: which of all it is, the host sees to.
    """
    trusted = {"id": "host", "link_protocols": ["tls"], "cert_common_names": [common_name("host")]}
    return {
        "mode": "router",
        "listen": _listen(listen),
        "connect": _connect(host, None),
        "access_control": _control(trusted, BEHIND_A_RELAY, f"{ROOT}/*"),
        **_common(_tls(credentials, "listen", "connect"), WAIT_AT_A_DOOR_MS),
    }


def access_control(namespace: str) -> Plain:
    """Who may do what: all on a socket that only its user reaches, else what the role of a certificate may."""
    return _control({"id": "this-machine", "link_protocols": ["unixsock-stream"]}, RIGHTS, namespace)


def _control(trusted: Plain, roles: Mapping[FarRole, Rights], namespace: str) -> Plain:
    """All for whom is trusted, else what a role may."""
    rules = [_rule("everything", list(EVERYTHING), ["ingress", "egress"], ["**"])]
    subjects: list[Plain] = [trusted]
    policies = [{"rules": ["everything"], "subjects": [trusted["id"]]}]
    for role, rights in roles.items():
        theirs = _rules(role, rights, namespace)
        rules += theirs
        subjects.append({"id": role, "link_protocols": ["tls"], "cert_common_names": [common_name(role)]})
        policies.append({"rules": [rule["id"] for rule in theirs], "subjects": [role]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }


def _rules(role: str, rights: Rights, namespace: str) -> list[Plain]:
    """Each right by its messages, to the router (`ingress`) and from it."""
    asked = [service.key for service in rights.asks]
    heard = [topic.key for topic in rights.hears]
    published = [topic.key for topic in rights.publishes]
    wanted = [
        ("publishes", "put", "ingress", published),
        ("listens", "declare_subscriber", "ingress", heard),
        ("hears", "put", "egress", heard),
        ("asks", "query", "ingress", asked),
        ("is-answered", "reply", "egress", asked),
        ("holds", "liveliness_token", "ingress", list(rights.holds)),
    ]
    if role == "relay":  # routers pass on only what they have been told that somebody answers, or wants to hear
        wanted += [
            ("knows-who-answers", "declare_queryable", "egress", asked),
            ("knows-who-listens", "declare_subscriber", "egress", published),
            ("knows-who-watches", "declare_liveliness_subscriber", "egress", [*rights.holds, ALL_ALIVE]),
        ]
    return [
        _rule(f"{role}-{name}", [message], [flow], [absolute(namespace, key) for key in found])
        for name, message, flow, found in wanted
        if found
    ]


def _rule(name: str, messages: list[str], flows: list[str], keys: list[str]) -> Plain:
    return {"id": name, "permission": "allow", "messages": messages, "flows": flows, "key_exprs": keys}


def _listen(*endpoints: str) -> Plain:
    return {"endpoints": list(endpoints), "exit_on_failure": True}


def _connect(endpoint: str, timeout_s: float | None) -> Plain:
    return {
        "endpoints": [endpoint],
        "timeout_ms": NO_TIMEOUT_MS if timeout_s is None else int(timeout_s * 1000),
        "exit_on_failure": timeout_s is not None,
        "retry": {"period_init_ms": 20, "period_max_ms": 500, "period_increase_factor": 1.5},
    }


def _tls(credentials: Credentials, *ends: str) -> Plain:
    """Both ends of a link show a certificate; `ends` are `connect` or `listen`, or both."""
    own = {
        f"{end}_{name}": str(path)
        for end in ends
        for name, path in (("certificate", credentials.certificate), ("private_key", credentials.key))
    }
    return {
        "tls": {
            "root_ca_certificate": str(credentials.authority),
            "enable_mtls": True,
            "verify_name_on_connect": True,
            **own,
        }
    }


def _common(link: Plain, wait_ms: int) -> Plain:
    return {
        "scouting": {"delay": 0, "multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "transport": {
            # A suspended reader was seen to get one message with the bytes of a later one.
            "shared_memory": {"enabled": False},
            "link": {
                "tx": {
                    "lease": LEASE_MS,
                    "queue": {"congestion_control": {"block": {"wait_before_close": wait_ms * 1000}}},
                },
                **link,
            },
        },
    }
