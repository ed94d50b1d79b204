"""Configurations of Zenoh with certificates and access control."""

from __future__ import annotations

import ssl
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from tfdb.data.argument_checks import unknown_word
from tfdb.data.errors import InvalidArgument
from tfdb.data.path_checks import check_path
from tfdb.data.stamps import shown

from .link import ALL, CONNECT_MS, ask_key, check_network_name, log_key, status_key, tokens_key
from .session import check_endpoints

if TYPE_CHECKING:
    import os
    from collections.abc import Iterable

Access: TypeAlias = Literal["read", "write"]
"""`read`: mirror the namespace. `write`: also be its home."""

_ROUTER = "tls/127.0.0.1:7447"


def secure(
    *,
    ca: str | os.PathLike[str],
    cert: str | os.PathLike[str],
    key: str | os.PathLike[str],
    connect: str | Iterable[str] = (),
    listen: str | Iterable[str] = (),
    allow: Mapping[str, Access | Mapping[str, Access]] | None = None,
) -> dict[str, Any]:
    """Make a configuration in which both ends of each connection prove their identity by TLS.

    `Session(config=)` takes it. Written as JSON, it is a file for `--config` and for `zenohd`.

    ```python
    config = tfdb.net.secure(
        ca="ca.pem", cert="robot1.pem", key="robot1.key", listen="tls/0.0.0.0:7447",
        allow={"fleet-reader": "read"},
    )
    ```

    Parameters
    ----------
    ca
        A PEM file of certificates. Only peers with a certificate signed by one of these can
        connect.
    cert, key
        PEM files with the certificate of this process and its key. If the process listens, the
        certificate must name the host to which others connect.
    connect, listen
        As in `Session`, with `tls/` before the address. Default: tls/127.0.0.1:7447.
    allow
        Permissions of peers that connect to `listen`, by the common names of their certificates:
        `"read"`, `"write"`, or one of them by namespace, such as `{"robot2": "write"}`. Other peers
        have no permissions; this process has all. None: every peer with a certificate has all
        permissions.

    Returns
    -------
    dict
        Zenoh's configuration.

    Raises
    ------
    InvalidArgument
        The certificate does not match the key or the authority, or has expired; an endpoint does
        not begin with `tls/`; `allow` without `listen`, or `allow` is invalid.
    OSError
        A file cannot be read.
    """
    there, here = _secure_endpoints("connect", connect), _secure_endpoints("listen", listen)
    if not there and not here:
        there = [_ROUTER]
    files = {"ca": str(check_path(ca)), "cert": str(check_path(cert)), "key": str(check_path(key))}
    own = _common_name(**files)
    config: dict[str, Any] = {
        "mode": "router" if here else "client",
        "connect": {
            "endpoints": there,
            "timeout_ms": CONNECT_MS,
            "exit_on_failure": bool(there),
        },
        "listen": {"endpoints": here, "exit_on_failure": True},
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "transport": {
            "link": {
                "protocols": ["tls"],
                "tls": {
                    "root_ca_certificate": files["ca"],
                    "listen_certificate": files["cert"],
                    "listen_private_key": files["key"],
                    "connect_certificate": files["cert"],
                    "connect_private_key": files["key"],
                    "enable_mtls": True,
                    "verify_name_on_connect": True,
                },
            }
        },
    }
    if allow is not None:
        if not here:
            raise InvalidArgument("allow needs listen: only a router controls access")
        config["access_control"] = _access_control(own, _checked(allow))
    return config


def _secure_endpoints(name: str, value: str | Iterable[str]) -> list[str]:
    found = check_endpoints(name, value, _ROUTER)
    for each in found:
        if not each.startswith("tls/"):
            text = f"{name} of secure must have endpoints such as {_ROUTER}, got {shown(each)}"
            raise InvalidArgument(text, value=each)
    return found


def _checked(allow: Any) -> dict[str, dict[str, Access]]:
    """Return the access by certificate and namespace; `ALL`: all."""
    if not isinstance(allow, Mapping):
        raise InvalidArgument(
            'allow must map common names to access, such as {"fleet-reader": "read"}, got '
            f"{shown(allow)}",
            value=allow,
        )
    found: dict[str, dict[str, Access]] = {}
    for user, what in allow.items():
        if not isinstance(user, str) or not user:
            raise InvalidArgument(
                f"allow: a key must be a certificate's common name, got {shown(user)}"
            )
        by_name = what if isinstance(what, Mapping) else {ALL: what}
        for name, access in by_name.items():
            if name != ALL:
                check_network_name(name)
            if access not in ("read", "write"):
                text = f"allow[{user!r}]: {unknown_word(str(access), ('read', 'write'))}"
                raise InvalidArgument(text, value=access)
        found[user] = dict(by_name)
    return found


# -- certificates ----------------------------------------------------------------------------------


def _common_name(ca: str, cert: str, key: str) -> str:
    """Return the common name of a certificate. Refuses one that the authority did not sign.

    A handshake in memory, with the certificate at both ends, validates it like the network.
    """
    server, client = (
        ssl.SSLContext(each) for each in (ssl.PROTOCOL_TLS_SERVER, ssl.PROTOCOL_TLS_CLIENT)
    )
    client.check_hostname = False
    for context in (server, client):
        _load(ca, context.load_verify_locations, ca)
        _load(f"{cert} with {key}", context.load_cert_chain, cert, key)
        context.verify_mode = ssl.CERT_REQUIRED
    one, other = ssl.MemoryBIO(), ssl.MemoryBIO()
    ends = [
        server.wrap_bio(one, other, server_side=True),
        client.wrap_bio(other, one),
    ]
    try:
        waiting = ends
        while waiting:
            waiting = [each for each in waiting if not _handshake_is_done(each)]
    except ssl.SSLError as error:
        text = f"{cert} is not a valid certificate of {ca} for both ends of a connection: {error}"
        raise InvalidArgument(text, value=cert) from error
    found = ends[1].getpeercert() or {}
    subject: Any = found.get("subject", ())
    names = [value for part in subject for what, value in part if what == "commonName"]
    if not names:
        raise InvalidArgument(f"{cert} has no common name: access control needs one", value=cert)
    return str(names[0])


def _handshake_is_done(end: ssl.SSLObject) -> bool:
    """Make one step of a handshake; return whether it is complete."""
    try:
        end.do_handshake()
    except ssl.SSLWantReadError:
        return False
    return True


def _load(what: str, load: Any, *files: str) -> None:
    for each in files:
        with open(each, "rb"):  # noqa: PTH123 - OSError names the file
            pass
    try:
        load(*files)
    except ssl.SSLError as error:
        raise InvalidArgument(f"{what}: not a certificate and its key, PEM: {error}") from error


# -- access control --------------------------------------------------------------------------------

# Keys that a router passes from and to a mirror, and additional ones of a home.
_LOG, _ASKED, _HOMES, _MIRRORS = "log", "asked", "homes", "mirrors"
_HOME_STATUS, _MIRROR_STATUS = "home's status", "mirror's status"
_RULES: dict[Access, list[tuple[str, list[str], list[str]]]] = {
    "read": [
        ("ingress", ["declare_subscriber"], [_LOG]),
        ("ingress", ["query"], [_ASKED, _HOME_STATUS, _MIRROR_STATUS]),
        ("ingress", ["declare_queryable", "reply"], [_MIRROR_STATUS]),
        ("ingress", ["liveliness_query", "declare_liveliness_subscriber"], [_HOMES, _MIRRORS]),
        ("ingress", ["liveliness_token"], [_MIRRORS]),
        ("egress", ["put"], [_LOG]),
        ("egress", ["query"], [_MIRROR_STATUS]),
        ("egress", ["declare_queryable", "reply"], [_ASKED, _HOME_STATUS, _MIRROR_STATUS]),
        ("egress", ["liveliness_token"], [_HOMES, _MIRRORS]),
    ],
    "write": [
        ("ingress", ["put"], [_LOG]),
        ("ingress", ["declare_queryable", "reply"], [_ASKED, _HOME_STATUS]),
        ("ingress", ["liveliness_token"], [_HOMES]),
        ("egress", ["declare_subscriber"], [_LOG]),
        ("egress", ["query"], [_ASKED, _HOME_STATUS]),
    ],
}


def _keys(name: str, what: str) -> list[str]:
    if what == _LOG:
        return [log_key(name)]
    if what == _ASKED:
        return [ask_key(name, state=state) for state in (False, True)]
    if what in (_HOME_STATUS, _MIRROR_STATUS):
        return [status_key(name, "home" if what == _HOME_STATUS else "mirror")]
    return [tokens_key(name, "home" if what == _HOMES else "mirror")]


def _access_control(own: str, allow: Mapping[str, Mapping[str, Access]]) -> dict[str, Any]:
    rules: dict[str, dict[str, Any]] = {}
    policies = []
    for user, names in {**allow, own: {ALL: "write"}}.items():
        used = [each for name, access in names.items() for each in _rules_for(name, access)]
        rules.update((each["id"], each) for each in used)
        policies.append({"subjects": [user], "rules": [each["id"] for each in used]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": list(rules.values()),
        "subjects": [{"id": user, "cert_common_names": [user]} for user in {**allow, own: None}],
        "policies": policies,
    }


def _rules_for(name: str, access: Any) -> list[dict[str, Any]]:
    kinds: list[Access] = ["read"] if access == "read" else ["read", "write"]
    return [
        {
            "id": f"{kind} {name} {number}",
            "permission": "allow",
            "flows": [flow],
            "messages": messages,
            "key_exprs": [key for what in keys for key in _keys(name, what)],
        }
        for kind in kinds
        for number, (flow, messages, keys) in enumerate(_RULES[kind])
    ]
