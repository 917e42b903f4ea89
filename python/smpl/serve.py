"""`smpl serve FILE.eq --opcua`: a plant in real time or faster behind OPC UA (extra `opcua`).

Tags below `Objects/Plant`: `Actions` (writable, within their limits), `Observations`, `States` and
`Status` (read-only), with unit and range; `Alarms` is true while a limit is violated. Methods:
`Start`, `Stop`, `Reset(seed)`, `SetSpeed(speed)`. Actions act at the next sampling instant.
"""

from __future__ import annotations

import argparse
import asyncio
import ipaddress
import socket
import sys
import time
from collections.abc import Sequence
from datetime import timedelta
from pathlib import Path
from typing import Any

import numpy as np

from smpl.collect import add_problem, environment, guarded, once
from smpl.envs import Env
from smpl.learning.plan import Task
from smpl.support.arguments import COUNTS, FloatArray, as_finite_number
from smpl.support.optional import load

NAMESPACE = "urn:smpl:plant"
# Values of a tag that its history keeps, and for how long.
_KEPT, _AGE = 10_000, timedelta(days=7)
_READ_ONLY = ("Observations", "States")
_SECONDS = {"us": 1e-6, "ms": 1e-3, "s": 1.0, "min": 60.0, "h": 3600.0, "d": 86400.0, "day": 86400.0, "week": 604800.0}


class Clock:
    """Sampling instants of a plant in wall time, which do not drift with the duration of steps.

    Args:
        interval: seconds of the plant between two instants.
        speed: seconds of the plant per second.

    Attributes:
        epoch: number of calls of `begin`.
    """

    def __init__(self, interval: float, speed: float) -> None:
        self.interval, self.speed, self.epoch = interval, speed, 0
        self.begin(time.monotonic())

    def begin(self, now: float) -> None:
        """Count instants from now on."""
        self._origin, self._count, self.epoch = now, 0, self.epoch + 1

    def set_speed(self, speed: float, now: float) -> None:
        """Change the speed from now on; the share of the interval that has passed stays."""
        share = (now - self._origin) * self.speed / self.interval - self._count
        self._origin, self._count, self.speed = now - share * self.interval / speed, 0, speed

    def due(self) -> float:
        """Monotonic time of the next instant."""
        return self._origin + (self._count + 1) * self.interval / self.speed

    def advance(self) -> None:
        """Count the next instant as reached."""
        self._count += 1


class Plant:
    """An environment whose actions are held until they are written.

    Attributes:
        env: in physical units, without a time limit.
        actions: in force from the next sampling instant on.
        running: whether it moves on at sampling instants.
        message: failure or success that has stopped it; empty while it can run.
    """

    def __init__(self, env: Env) -> None:
        self.env, self.running, self.message = env, False, ""
        self.violations: dict[str, float] = {}
        self.reset(0)

    def reset(self, seed: int) -> None:
        """Start an episode with nominal actions.

        Raises:
            SimulationError: the model has no consistent start.
        """
        _, info = self.env.reset(seed=seed)
        self.actions = np.array(self.env.model.native.defaults("action"))
        self.message, self.violations = "", dict(info["constraints"])

    def step(self) -> None:
        """Go on to the next sampling instant."""
        _, _, terminated, truncated, info = self.env.step(self.actions)
        self.violations = dict(info["constraints"])
        if terminated or truncated:
            self.running = False
            self.message = info["failure"] or ("success" if info["success"] else "end of the episode")


class OpcUaServer:
    """The OPC UA server of a plant; an asynchronous context manager.

    Args:
        plant: the plant.
        host, port: where it listens; port 0 picks a free one.
        speed: seconds of the plant per second.
        certificate, key: files; with them connections are signed and encrypted, without them they
            are not.

    Attributes:
        address: `opc.tcp://HOST:PORT/smpl`.
        late: largest delay of a sampling instant in seconds.

    Raises:
        ImportError: the package `asyncua` is missing.
        ValueError: a speed that is not positive, or a host other than the loopback without a
            certificate.
    """

    def __init__(
        self,
        plant: Plant,
        *,
        host: str = "127.0.0.1",
        port: int = 4840,
        speed: float = 1.0,
        certificate: str | Path | None = None,
        key: str | Path | None = None,
    ) -> None:
        self._package = load("asyncua", "smpl serve --opcua")
        if (certificate is None) != (key is None):
            raise ValueError("a certificate and its private key belong together; pass both")
        if certificate is None and not _is_loopback(host):
            raise ValueError(f"host is {host!r}: connections from other machines need --certificate and --key")
        self.plant, self._secured = plant, (certificate, key)
        model = plant.env.model
        self.clock = Clock(float(model.step) * _seconds(model.time_unit), _speed(speed))
        self.address = f"opc.tcp://{host}:{port or _free_port(host)}/smpl"
        self.late = 0.0
        self._tags: dict[str, list[Any]] = {}
        self._status: dict[str, Any] = {}
        self._moving: asyncio.Task[None] | None = None
        self._lock, self._retimed = asyncio.Lock(), asyncio.Event()

    async def __aenter__(self) -> OpcUaServer:
        await self._build()
        await self._server.start()
        self.clock.begin(time.monotonic())
        self._moving = asyncio.create_task(self._run())
        return self

    async def __aexit__(self, *_: Any) -> None:
        if self._moving is not None:
            self._moving.cancel()
            await asyncio.gather(self._moving, return_exceptions=True)
        await self._server.stop()

    async def _build(self) -> None:
        ua, model = self._package.ua, self.plant.env.model
        self._server = server = self._package.Server(user_manager=_everybody())
        await server.init()
        server.set_endpoint(self.address)
        server.set_server_name(f"smpl {model.name}")
        await self._secure(ua.SecurityPolicyType)
        self._index = index = await server.register_namespace(NAMESPACE)
        plant = await server.nodes.objects.add_object(index, "Plant")
        for folder, role in (("Actions", "action"), ("Observations", "observation"), ("States", "state")):
            await self._add_tags(plant, folder, role)
        await self._add_status(plant)
        await self._add_methods(plant)
        self._events = await server.get_event_generator()
        for folder in _READ_ONLY:
            await server.historize_node_data_change(self._tags[folder], _AGE, _KEPT)
        await self._show()

    async def _secure(self, policies: Any) -> None:
        certificate, key = self._secured
        if certificate is None or key is None:
            self._server.set_security_policy([policies.NoSecurity])
            return
        for file in (certificate, key):
            if not Path(file).is_file():
                raise ValueError(f"{str(file)!r} is not there")
        await self._server.load_certificate(str(certificate))
        await self._server.load_private_key(str(key))
        self._server.set_security_policy([policies.Basic256Sha256_SignAndEncrypt, policies.Basic256Sha256_Sign])

    async def _add_tags(self, plant: Any, name: str, role: str) -> None:
        ua, model = self._package.ua, self.plant.env.model
        folder = await plant.add_folder(self._index, name)
        low, high = model.native.bounds(role)
        names, units = getattr(model, f"{role}_names"), getattr(model, f"{role}_units")
        self._tags[name] = []
        for at, (tag, unit) in enumerate(zip(names, units, strict=True)):
            node_id = ua.NodeId(f"{name}.{tag}", self._index)
            node = await folder.add_variable(node_id, self._named(tag), 0.0, ua.VariantType.Double)
            about = ua.EUInformation(DisplayName=ua.LocalizedText(unit), NamespaceUri=NAMESPACE)
            ends = ua.Range(float(low[at]), float(high[at]))
            for key, value in (("EngineeringUnits", about), ("EURange", ends)):
                place = ua.NodeId(f"{name}.{tag}.{key}", self._index)
                await node.add_property(place, ua.QualifiedName(key, 0), value)
            if role == "action":
                await node.set_writable()
                self._server.set_attribute_value_setter(node.nodeid, self._setter(at, float(low[at]), float(high[at])))
            self._tags[name].append(node)

    def _setter(self, at: int, low: float, high: float) -> Any:
        """Setter of an action that clients write: values within its limits."""
        errors = self._package.ua.uaerrors

        def write(node: Any, attribute: Any, value: Any) -> None:
            number = None if value.Value is None else value.Value.Value
            if number is None or value.Value.is_array:
                raise errors.BadTypeMismatch()
            if not low <= number <= high:
                raise errors.BadOutOfRange()
            self.plant.actions[at] = number
            node.attributes[attribute].value = value

        return write

    async def _add_status(self, plant: Any) -> None:
        types = self._package.ua.VariantType
        folder = await plant.add_folder(self._index, "Status")
        rows = [
            ("Time", 0.0, types.Double), ("Step", 0, types.UInt32), ("Running", False, types.Boolean),
            ("Speed", 1.0, types.Double), ("Message", "", types.String), ("Delay", 0.0, types.Double),
        ]  # fmt: skip
        for name, value, kind in rows:
            node_id = self._package.ua.NodeId(f"Status.{name}", self._index)
            self._status[name] = await folder.add_variable(node_id, self._named(name), value, kind)
        alarms = await plant.add_folder(self._index, "Alarms")
        self._alarms = {}
        for name in self.plant.env.constraint_names:
            node_id = self._package.ua.NodeId(f"Alarms.{name}", self._index)
            self._alarms[name] = await alarms.add_variable(node_id, self._named(name), False, types.Boolean)

    async def _add_methods(self, plant: Any) -> None:
        types, errors = self._package.ua.VariantType, self._package.ua.uaerrors

        async def start() -> None:
            if self.plant.message:
                raise errors.BadInvalidState()
            if not self.plant.running:
                self.plant.running = True
                self._restart()
            await self._show()

        async def stop() -> None:
            async with self._lock:  # behind a step that has begun
                self.plant.running = False
            await self._show()

        async def reset(seed: int) -> None:
            if not 0 <= seed < 2**32:
                raise errors.BadOutOfRange()
            async with self._lock:
                try:
                    await asyncio.to_thread(self.plant.reset, seed)
                except (RuntimeError, ValueError) as error:
                    self.plant.running, self.plant.message = False, str(error)
                self._restart()
            await self._show()
            if self.plant.message:
                raise errors.BadInvalidState()

        async def set_speed(speed: float) -> None:
            if not 0 < speed < np.inf:
                raise errors.BadOutOfRange()
            self.clock.set_speed(float(speed), time.monotonic())
            self._retimed.set()
            await self._show()

        for function, name, inputs in (
            (start, "Start", []),
            (stop, "Stop", []),
            (reset, "Reset", [("seed", types.UInt32)]),
            (set_speed, "SetSpeed", [("speed", types.Double)]),
        ):
            node_id = self._package.ua.NodeId(name, self._index)
            arguments = [self._argument(*one) for one in inputs]
            await plant.add_method(node_id, self._named(name), self._method(function, inputs), arguments, [])

    def _argument(self, name: str, kind: Any) -> Any:
        ua = self._package.ua
        return ua.Argument(Name=name, DataType=ua.NodeId(kind.value), ValueRank=-1)

    def _method(self, function: Any, inputs: Any) -> Any:
        """A method that answers wrong arguments with their status code."""
        ua = self._package.ua
        codes = ua.StatusCodes

        async def called(parent: Any, *variants: Any) -> Any:
            if len(variants) != len(inputs):
                few = len(variants) < len(inputs)
                return ua.StatusCode(codes.BadArgumentsMissing if few else codes.BadTooManyArguments)
            values = [one.Value for one in variants]
            for value, (_, kind) in zip(values, inputs, strict=True):
                numbers = int if kind is ua.VariantType.UInt32 else (int, float)
                if isinstance(value, bool) or not isinstance(value, numbers):
                    return ua.StatusCode(codes.BadTypeMismatch)
            try:
                await function(*values)
            except ua.uaerrors.UaStatusCodeError as error:
                return ua.StatusCode(error.code)
            return []

        return called

    def _named(self, name: str) -> Any:
        return self._package.ua.QualifiedName(name, self._index)

    def _restart(self) -> None:
        """Begin an interval now."""
        self.clock.begin(time.monotonic())
        self._retimed.set()

    async def _run(self) -> None:
        """Step at each sampling instant while the plant runs; late instants are not skipped."""
        while True:
            self._retimed.clear()
            if not self.plant.running:
                await asyncio.sleep(0.02)
                continue
            epoch, due = self.clock.epoch, self.clock.due()
            if await self._is_retimed(due - time.monotonic()):
                continue
            self.late = max(0.0, time.monotonic() - due)
            async with self._lock:
                if self.clock.epoch != epoch:  # another episode
                    continue
                self.clock.advance()
                if self.plant.running:
                    await self._step()
            await self._show()

    async def _is_retimed(self, wait: float) -> bool:
        """Wait; true as soon as a method has changed the time of the next instant."""
        if wait <= 0:
            await asyncio.sleep(0)
            return self._retimed.is_set()
        try:
            await asyncio.wait_for(self._retimed.wait(), wait)
        except asyncio.TimeoutError:
            return False
        return True

    async def _step(self) -> None:
        before = self.plant.violations
        try:
            await asyncio.to_thread(self.plant.step)
        except (RuntimeError, ValueError) as error:
            self.plant.running, self.plant.message = False, str(error)
        for name, excess in self.plant.violations.items():
            if excess > 0 and not before.get(name, 0.0) > 0:
                await self._raise_event(f"{name} is violated by {excess:.3g} of its range", 500)
        if self.plant.message:
            await self._raise_event(self.plant.message, 900)

    async def _raise_event(self, text: str, severity: int) -> None:
        self._events.event.Severity = severity
        await self._events.trigger(message=text)

    async def _show(self) -> None:
        """Write what is measured to the tags, between steps."""
        async with self._lock:
            await self._write_tags()

    async def _write_tags(self) -> None:
        env, types = self.plant.env, self._package.ua.VariantType
        values: dict[str, FloatArray] = {
            "Observations": env.reading,
            "States": env.state,
            "Actions": self.plant.actions,
        }
        for folder, row in values.items():
            for node, value in zip(self._tags[folder], row.tolist(), strict=True):
                await self._write(node, value, types.Double)
        status = {"Time": env.time, "Step": env.steps, "Running": self.plant.running, "Speed": self.clock.speed,
                  "Message": self.plant.message, "Delay": self.late}  # fmt: skip
        kinds = {"Step": types.UInt32, "Running": types.Boolean, "Message": types.String}
        for name, value in status.items():
            await self._write(self._status[name], value, kinds.get(name, types.Double))
        for name, node in self._alarms.items():
            await self._write(node, self.plant.violations.get(name, 0.0) > 0, types.Boolean)

    async def _write(self, node: Any, value: Any, kind: Any) -> None:
        await node.write_value(value, kind)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command and return its exit status."""
    parser = argparse.ArgumentParser("smpl serve", description="A plant that control systems can talk to.")
    once(parser)
    parser.add_argument("env", metavar="FILE.eq", help="path or name of a model, or the id of an environment")
    parser.add_argument("--opcua", action="store_true", required=True, help="serve it over OPC UA")
    parser.add_argument("--port", type=int, default=4840, metavar="N", help="default: 4840; 0 picks a free one")
    parser.add_argument("--host", default="127.0.0.1", metavar="HOST", help="default: this machine only")
    parser.add_argument("--speed", type=float, default=1.0, metavar="X", help="times real time; default: 1")
    parser.add_argument("--start", action="store_true", help="run at once; otherwise at a call of Start")
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="of the first episode")
    parser.add_argument("--certificate", metavar="FILE", help="certificate of the server (.der, .pem)")
    parser.add_argument("--key", metavar="FILE", help="its private key")
    add_problem(parser)
    given = parser.parse_args(arguments)
    return guarded(lambda: _serve(given))


def plant_of(env: Any, seed: int = 0, **arguments: Any) -> Plant:
    """The plant of an environment, in physical units and without the scenario's time limit.

    Args:
        env, arguments: as for `smpl.learning.plan.Task.of`.
        seed: of the first episode.
    """
    given = {"normalize": False, "max_steps": COUNTS - 1, **{k: v for k, v in arguments.items() if v is not None}}
    plant = Plant(Task.of(env, **given).env())
    plant.reset(seed)
    return plant


def _serve(given: argparse.Namespace) -> int:
    if not 0 <= given.port < 65536:
        raise ValueError(f"port is {given.port}, expected 0 to 65535")
    load("asyncua", "smpl serve --opcua")
    plant = plant_of(given.env, given.seed, **environment(given))
    plant.running = given.start

    async def serve() -> None:
        server = OpcUaServer(
            plant, host=given.host, port=given.port, speed=given.speed, certificate=given.certificate, key=given.key
        )
        async with server:
            print(server.address, flush=True)
            await asyncio.Event().wait()

    try:
        asyncio.run(serve())
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)
    return 0


def _everybody() -> Any:
    """Every client is a user, none an administrator, who could write to all tags."""
    managers, roles = load("asyncua.server.user_managers", "OPC UA"), load("asyncua.crypto.permission_rules", "OPC UA")
    base: Any = managers.UserManager

    class Everybody(base):  # type: ignore[misc]
        def get_user(self, iserver: Any, username: Any = None, password: Any = None, certificate: Any = None) -> Any:
            return roles.User(role=roles.UserRole.User)

    return Everybody()


def _seconds(unit: str) -> float:
    if unit not in _SECONDS:
        raise ValueError(f"the model's unit of time is {unit!r}; a served plant needs one of {', '.join(_SECONDS)}")
    return _SECONDS[unit]


def _speed(speed: Any) -> float:
    number = as_finite_number("speed", speed)
    if number <= 0:
        raise ValueError(f"speed is {speed}, expected a positive number")
    return number


def _is_loopback(host: str) -> bool:
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def _free_port(host: str) -> int:
    with socket.socket() as probe:
        probe.bind((host, 0))
        return int(probe.getsockname()[1])


if __name__ == "__main__":
    raise SystemExit(main())
