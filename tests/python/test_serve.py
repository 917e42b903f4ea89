"""A plant behind OPC UA, seen by clients: `asyncua` on both sides, the client in its own process or loop."""

import asyncio
import subprocess
import sys
import time

import numpy as np
import pytest

import smpl

asyncua = pytest.importorskip("asyncua", reason="asyncua is not installed")

from asyncua import Client, ua  # noqa: E402

from smpl.serve import Clock, OpcUaServer, plant_of  # noqa: E402

CONTROL = """
import asyncio, sys
from asyncua import Client

async def main(address):
    async with Client(address) as client:
        index = await client.get_namespace_index("urn:smpl:plant")
        node = lambda name: client.get_node(f"ns={index};s={name}")
        temperature, jacket = node("Observations.T"), node("Actions.T_c")
        plant = await client.nodes.objects.get_child(f"{index}:Plant")
        await plant.call_method(f"{index}:Start")
        integral, last = 0.0, -1
        while last < 60:
            step = await node("Status.Step").read_value()
            if step == last:
                await asyncio.sleep(0.002)
                continue
            last, error = step, SET_POINT - await temperature.read_value()
            integral += 0.1 * error
            await jacket.write_value(min(max(STEADY + GAIN * error + integral, 15.0), 35.0))
        print(await temperature.read_value(), await node("Status.Message").read_value() or "runs")

asyncio.run(main(sys.argv[1]))
"""


def serving(test, **options):
    """Run a test with a server on a free port."""
    options = {"model": "reactor", "speed": 600.0, **options}
    plant = plant_of(options.pop("model"), 3)

    async def run():
        async with OpcUaServer(plant, port=0, **options) as server:
            await test(server, plant)

    asyncio.run(run())


def node(client, name):
    return client.get_node(f"ns={client.smpl};s={name}")


async def connected(server):
    client = Client(server.address)
    await client.connect()
    client.smpl = await client.get_namespace_index("urn:smpl:plant")
    return client


async def call(client, method, *values):
    plant = await client.nodes.objects.get_child(f"{client.smpl}:Plant")
    return await plant.call_method(f"{client.smpl}:{method}", *values)


async def until(condition, seconds=30):
    end = time.monotonic() + seconds
    while not await condition():
        assert time.monotonic() < end, "it does not happen"
        await asyncio.sleep(0.01)


def test_tags_have_values_units_and_ranges_of_the_model():
    async def test(server, plant):
        client = await connected(server)
        assert await node(client, "Actions.T_c").read_value() == plant.env.model.native.defaults("action")[0]
        temperature = node(client, "Observations.T")
        assert await temperature.read_value() == pytest.approx(plant.env.reading[1], rel=1e-12)
        unit = await (await temperature.get_child("0:EngineeringUnits")).read_value()
        ends = await (await temperature.get_child("0:EURange")).read_value()
        assert unit.DisplayName.Text == "degC"
        assert (ends.Low, ends.High) == (plant.env.observation_low[1], plant.env.observation_high[1])
        assert await node(client, "States.c_A").read_value() == plant.env.state[0]
        assert await node(client, "Status.Running").read_value() is False
        await client.disconnect()

    serving(test)


def test_the_served_plant_takes_the_steps_of_the_environment():
    async def test(server, plant):
        client = await connected(server)
        await call(client, "Reset", ua.Variant(11, ua.VariantType.UInt32))
        await node(client, "Actions.T_c").write_value(30.0)
        await call(client, "Start")
        await until(lambda: at_least(client, 5))
        await call(client, "Stop")
        steps = await node(client, "Status.Step").read_value()
        env = smpl.Env("reactor", normalize=False)
        env.reset(seed=11)
        for _ in range(steps):
            env.step(np.array([30.0, 0.1]))
        assert await node(client, "States.T").read_value() == env.state[1]
        await client.disconnect()

    serving(test)


async def at_least(client, steps):
    return await node(client, "Status.Step").read_value() >= steps


def test_stop_waits_for_a_step_that_has_begun():
    async def test(server, plant):
        client, step = await connected(server), plant.step
        begun = []

        def slowly():
            begun.append(time.monotonic())
            time.sleep(1.0)
            step()

        plant.step = slowly
        await call(client, "Start")
        while not begun:
            await asyncio.sleep(0.01)
        await call(client, "Stop")
        steps = await node(client, "Status.Step").read_value()
        await asyncio.sleep(1.5)
        assert (steps, plant.env.steps) == (1, 1)
        await client.disconnect()

    serving(test)


def test_writes_to_read_only_tags_wrong_types_and_ranges_are_refused():
    async def test(server, plant):
        client = await connected(server)
        before = plant.actions.copy(), plant.env.state.copy()
        with pytest.raises(ua.uaerrors.BadUserAccessDenied):
            await node(client, "States.T").write_value(300.0)
        with pytest.raises(ua.uaerrors.BadUserAccessDenied):
            await node(client, "Status.Speed").write_value(2.0)
        with pytest.raises(ua.uaerrors.BadTypeMismatch):
            await node(client, "Actions.T_c").write_value("warm")
        for value in (ua.Variant(25, ua.VariantType.Int32), ua.Variant([25.0], ua.VariantType.Double)):
            with pytest.raises(ua.uaerrors.BadTypeMismatch):
                await node(client, "Actions.T_c").write_value(value)
        for value in (50.0, float("nan"), float("inf")):
            with pytest.raises(ua.uaerrors.BadOutOfRange):
                await node(client, "Actions.T_c").write_value(value)
        assert np.array_equal(plant.actions, before[0]) and np.array_equal(plant.env.state, before[1])
        await client.disconnect()

    serving(test)


def test_wrong_arguments_of_methods_are_answered_by_their_status():
    async def test(server, plant):
        client = await connected(server)
        for method, values, error in (
            ("SetSpeed", [-1.0], ua.uaerrors.BadOutOfRange),
            ("SetSpeed", [float("nan")], ua.uaerrors.BadOutOfRange),
            ("SetSpeed", ["fast"], ua.uaerrors.BadTypeMismatch),
            ("SetSpeed", [], ua.uaerrors.BadArgumentsMissing),
            ("Start", [1.0], ua.uaerrors.BadTooManyArguments),
            ("Reset", [1.5], ua.uaerrors.BadTypeMismatch),
            ("Reset", [-1], ua.uaerrors.BadOutOfRange),
        ):
            with pytest.raises(error):
                await call(client, method, *values)
        plant.message = "empty: h"
        with pytest.raises(ua.uaerrors.BadInvalidState):
            await call(client, "Start")
        await call(client, "Reset", 3)
        assert await node(client, "Status.Message").read_value() == ""
        reset = await client.nodes.objects.get_child([f"{client.smpl}:Plant", f"{client.smpl}:Reset"])
        (argument,) = await (await reset.get_child("0:InputArguments")).read_value()
        assert argument.Name == "seed"
        await client.disconnect()

    serving(test)


def test_a_new_speed_acts_within_the_interval():
    """An interval of 6 s at a thousandth of real time lasts 100 minutes."""

    async def test(server, plant):
        client = await connected(server)
        await call(client, "Start")
        await asyncio.sleep(0.1)
        await call(client, "SetSpeed", 600.0)
        await until(lambda: at_least(client, 3), seconds=20)
        await client.disconnect()

    serving(test, speed=1e-3)


def test_a_plant_that_runs_from_the_start_begins_with_the_server(monkeypatch):
    """The time in which the server is set up does not count."""
    build = OpcUaServer._build

    async def slowly(server):
        await build(server)
        await asyncio.sleep(1.0)

    monkeypatch.setattr(OpcUaServer, "_build", slowly)
    plant = plant_of("reactor", 3)
    plant.running = True

    async def run():
        async with OpcUaServer(plant, port=0, speed=10.0):
            assert plant.env.steps == 0
            await asyncio.sleep(0.2)
            assert plant.env.steps == 0

    asyncio.run(run())


def test_ten_clients_and_a_lost_connection_do_not_stop_the_plant():
    async def test(server, plant):
        clients = [await connected(server) for _ in range(10)]
        await call(clients[0], "Start")
        await until(lambda: at_least(clients[9], 3))
        clients[0].uaclient.protocol.transport.abort()
        reached = await node(clients[1], "Status.Step").read_value()
        await until(lambda: at_least(clients[1], reached + 5))
        values = [await node(one, "Actions.T_c").read_value() for one in clients[1:]]
        assert len(set(values)) == 1
        for one in clients[1:]:
            await one.disconnect()
        again = await connected(server)
        assert await node(again, "Status.Running").read_value() is True
        await again.disconnect()

    serving(test)


def test_a_failure_stops_the_plant_raises_an_alarm_and_a_reset_goes_on():
    async def test(server, plant):
        client = await connected(server)
        plant.env.reset(seed=0, options={"state": {"T": 51.0, "h": 0.52}})
        await node(client, "Actions.q_out").write_value(0.2)
        await call(client, "Start")
        await until(lambda: not_running(client))
        assert (await node(client, "Status.Message").read_value()).startswith("empty: ")
        children = await (
            await client.nodes.objects.get_child([f"{client.smpl}:Plant", f"{client.smpl}:Alarms"])
        ).get_children()
        assert True in [await one.read_value() for one in children]
        with pytest.raises(ua.uaerrors.BadInvalidState):
            await call(client, "Start")
        await call(client, "Reset", ua.Variant(1, ua.VariantType.UInt32))
        assert await node(client, "Status.Message").read_value() == ""
        await call(client, "Start")
        await until(lambda: at_least(client, 2))
        await client.disconnect()

    serving(test)


async def not_running(client):
    return not await node(client, "Status.Running").read_value()


def test_history_has_the_measurements():
    async def test(server, plant):
        client = await connected(server)
        await call(client, "Start")
        await until(lambda: at_least(client, 5))
        await call(client, "Stop")
        values = await node(client, "Observations.T").read_raw_history(numvalues=100)
        assert len({one.Value.Value for one in values}) >= 5
        await client.disconnect()

    serving(test)


def test_sampling_instants_do_not_drift():
    """1,000 steps of 6 s at 3,000 times real time take 2 s, however long each takes, if the machine keeps up."""
    clock, instants = Clock(6.0, 3000.0), []
    clock.begin(10.0)
    for _ in range(1000):
        instants.append(clock.due())
        clock.advance()
    assert instants == pytest.approx([10.0 + 0.002 * (k + 1) for k in range(1000)], abs=1e-9)
    clock.set_speed(6000.0, 12.0)
    assert clock.due() == pytest.approx(12.0 + 0.001, abs=1e-9)
    clock.set_speed(3000.0, 12.0005)  # half of the interval is left
    assert clock.due() == pytest.approx(12.0005 + 0.001, abs=1e-9)

    async def test(server, plant):
        client = await connected(server)
        begin = time.monotonic()
        await call(client, "Start")
        await until(lambda: at_least(client, 40))
        elapsed = time.monotonic() - begin
        # 40 steps of 0.1 min at 60 times real time, with polling and a busy machine.
        assert elapsed >= 4.0 - 0.2
        await client.disconnect()

    serving(test, speed=60.0)


def test_a_pid_in_another_process_regulates_the_reactor(tmp_path):
    steady = smpl.Env("reactor", normalize=False)
    steady.reset(seed=0, options={"start": "steady"})
    text = CONTROL.replace("SET_POINT", repr(float(steady.state[1])))
    script = tmp_path / "control.py"
    script.write_text(text.replace("STEADY", repr(float(steady.action[0]) or 26.85)).replace("GAIN", "1.0"))

    async def test(server, plant):
        process = await asyncio.create_subprocess_exec(
            sys.executable, str(script), server.address, stdout=subprocess.PIPE, stderr=subprocess.PIPE
        )
        out, err = await asyncio.wait_for(process.communicate(), 100)
        assert process.returncode == 0, err.decode()
        value, message = out.split()
        assert message == b"runs"
        assert float(value) == pytest.approx(steady.state[1], abs=1.0)

    serving(test, speed=60.0)


def test_the_command_prints_its_address_and_refuses_what_it_cannot_do(capsys):
    from smpl.commands.main import main

    process = subprocess.Popen(
        [sys.executable, "-m", "smpl", "serve", "reactor", "--opcua", "--port", "0"], stdout=subprocess.PIPE, text=True
    )
    try:
        address = process.stdout.readline().strip()
        assert address.startswith("opc.tcp://127.0.0.1:")

        async def look():
            async with Client(address) as client:
                client.smpl = await client.get_namespace_index("urn:smpl:plant")
                return await node(client, "Status.Speed").read_value()

        assert asyncio.run(look()) == 1.0
    finally:
        process.kill()
        process.wait()
    assert main(["serve", "reactor", "--opcua", "--speed", "-1"]) == 1
    assert "speed is -1.0, expected a positive number" in capsys.readouterr().err
    assert main(["serve", "reactor", "--opcua", "--host", "0.0.0.0"]) == 1
    assert "need --certificate and --key" in capsys.readouterr().err
    assert main(["serve", "missing.eq", "--opcua"]) == 1
