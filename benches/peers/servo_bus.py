#!/usr/bin/env python3
"""Second opinions of the servo protocol: MoBeE's packet layer, rustypot and Feetech's own SDK on one bus of simulated servos.

    python3 -m venv venv && venv/bin/pip install rustypot==1.13.1 feetech-servo-sdk==1.0.0
    cargo build --release -p mobee-conformance -p mobee-feetech --examples
    venv/bin/python benches/peers/servo_bus.py [--examples target/release/examples] [--rounds 200]

Each client in turn writes registers, and every client must then read the same bytes: goals and a ramp singly and by sync write, an
offset as sign and magnitude, limits, the lock. Then torque, a motion, and equal states. Prints a line per comparison; exit code 1 if any
differs. Clients that are not installed are skipped, loudly.
"""
import argparse
import importlib.util
import os
import statistics
import subprocess
import sys
import tempfile
import time

IDS = [1, 2, 3, 4, 5, 6]
# the registers: name, address, bytes
IDENTITY, LIMITS, OFFSET, MODE, TORQUE, RAMP, GOAL, LOCK, POSITION = (0, 40), (9, 4), (31, 2), (33, 1), (40, 1), (41, 1), (42, 2), (55, 1), (56, 2)


class Mobee:
    """MoBeE's packet layer, as the example `registers`."""

    name = "mobee"

    def __init__(self, port, examples):
        self.process = subprocess.Popen([os.path.join(examples, "registers"), port], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def ask(self, *words):
        self.process.stdin.write(" ".join(str(w) for w in words) + "\n")
        self.process.stdin.flush()
        answer = self.process.stdout.readline().split()
        if not answer or answer[0] != "ok":
            raise RuntimeError(f"{words}: {' '.join(answer)}")
        return {int(a.split("=")[0]): bytes.fromhex(a.split("=")[1]) for a in answer[1:]}

    def ping(self, servo):
        return servo in self.ask("ping", servo)

    def read(self, servo, register):
        return self.ask("read", servo, *register)[servo]

    def write(self, servo, register, data):
        self.ask("write", servo, register[0], data.hex())

    def sync_read(self, register):
        found = self.ask("sync_read", *register, *IDS)
        return [found[i] for i in IDS]

    def sync_write(self, register, data):
        self.ask("sync_write", register[0], *[f"{i}={d.hex()}" for i, d in zip(IDS, data)])

    def close(self):
        self.process.stdin.close()
        self.process.wait(10)


class Rustypot:
    """rustypot, by its raw registers."""

    name = "rustypot"
    module = "rustypot"

    def __init__(self, port, _examples):
        import rustypot

        self.bus = rustypot.Sts3215PyController(serial_port=port, baudrate=1_000_000, timeout=0.2)

    def ping(self, servo):
        return bool(self.bus.ping(servo))

    def read(self, servo, register):
        return bytes(self.bus.read_raw_data(servo, *register))

    def write(self, servo, register, data):
        self.bus.write_raw_data(servo, register[0], list(data))

    def sync_read(self, register):
        return [bytes(d) for d in self.bus.sync_read_raw_data(IDS, *register)]

    def sync_write(self, register, data):
        self.bus.sync_write_raw_data(IDS, register[0], [list(d) for d in data])

    def close(self):
        self.bus.close()


class FeetechSdk:
    """Feetech's own SDK for Python (end 0: little endian, as STS servos are)."""

    name = "feetech-servo-sdk"
    module = "scservo_sdk"

    def __init__(self, port, _examples):
        import scservo_sdk

        self.sdk = scservo_sdk
        self.port = scservo_sdk.PortHandler(port)
        self.packets = scservo_sdk.PacketHandler(0)
        if not (self.port.openPort() and self.port.setBaudRate(1_000_000)):
            raise RuntimeError(f"the SDK can't open {port}")
        # its own deadline follows from the bytes alone, and is too short for a busy machine
        handler = self.port
        handler.setPacketTimeout = lambda _length: handler.setPacketTimeoutMillis(200)

    def good(self, result, what):
        if result != self.sdk.COMM_SUCCESS:
            raise RuntimeError(f"{what}: {self.packets.getTxRxResult(result)}")

    def ping(self, servo):
        _model, result, _error = self.packets.ping(self.port, servo)
        return result == self.sdk.COMM_SUCCESS

    def read(self, servo, register):
        data, result, _error = self.packets.readTxRx(self.port, servo, *register)
        self.good(result, "read")
        return bytes(data)

    def write(self, servo, register, data):
        result, _error = self.packets.writeTxRx(self.port, servo, register[0], len(data), list(data))
        self.good(result, "write")

    def sync_read(self, register):
        group = self.sdk.GroupSyncRead(self.port, self.packets, *register)
        for servo in IDS:
            group.addParam(servo)
        self.good(group.txRxPacket(), "sync read")
        return [bytes(group.getData(i, register[0] + at, 1) for at in range(register[1])) for i in IDS]

    def sync_write(self, register, data):
        group = self.sdk.GroupSyncWrite(self.port, self.packets, *register)
        for servo, value in zip(IDS, data):
            group.addParam(servo, list(value))
        self.good(group.txPacket(), "sync write")

    def close(self):
        self.port.closePort()


class Check:
    """Counts comparisons."""

    def __init__(self):
        self.made = self.differing = 0

    def same(self, what, answers):
        """Prints whether all answers, by client, are equal."""
        self.made += 1
        if len({repr(a) for a in answers.values()}) == 1:
            print(f"ok    {what}: {show(next(iter(answers.values())))}")
        else:
            self.differing += 1
            print(f"DIFF  {what}: " + "; ".join(f"{name} {show(a)}" for name, a in answers.items()))


def show(value):
    if isinstance(value, bytes):
        return value.hex()
    return " ".join(show(v) for v in value) if isinstance(value, list) else str(value)


def word(value, sign_bit=15):
    return (abs(value) | (1 << sign_bit if value < 0 else 0)).to_bytes(2, "little")


def with_each(clients, port, examples, act):
    """What each client answers; a port belongs to one client at a time."""
    answers = {}
    for client in clients:
        bus = client(port, examples)
        try:
            answers[client.name] = act(bus)
        finally:
            bus.close()
    return answers


def writes(bus, round_):
    """One client's writes, different in each round."""
    bus.write(1, LOCK, b"\x00")
    bus.write(1, OFFSET, word(-100 - round_, 11))
    bus.write(1, LIMITS, (500 + round_).to_bytes(2, "little") + (3500 - round_).to_bytes(2, "little"))
    bus.write(1, LOCK, b"\x01")
    bus.sync_write(RAMP, [bytes([50 + round_])] * len(IDS))
    bus.sync_write(GOAL, [word(2000 + 10 * servo + round_) for servo in IDS])
    bus.write(6, GOAL, word(1900 + round_))
    return True


def compare(clients, port, examples, check):
    answer = lambda act: with_each(clients, port, examples, act)
    check.same("pings of ids 1 and 9", answer(lambda bus: [bus.ping(1), ping_of_none(bus)]))
    check.same("identity of servo 2 (40 bytes)", answer(lambda bus: bus.read(2, IDENTITY)))
    for round_, writer in enumerate(clients):
        with_each([writer], port, examples, lambda bus: writes(bus, round_))
        by = f"written by {writer.name}"
        check.same(f"offset {-100 - round_}, {by}", answer(lambda bus: bus.read(1, OFFSET)))
        check.same(f"limits, {by}", answer(lambda bus: bus.read(1, LIMITS)))
        check.same(f"lock, {by}", answer(lambda bus: bus.read(1, LOCK)))
        check.same(f"ramps, {by}", answer(lambda bus: bus.sync_read(RAMP)))
        check.same(f"goals, {by}", answer(lambda bus: bus.sync_read(GOAL)))
        check.same(f"position of servo 1 by its offset, {by}", answer(lambda bus: bus.read(1, POSITION)))
    mover = clients[-1]
    with_each([mover], port, examples, lambda bus: bus.sync_write(TORQUE, [b"\x01"] * len(IDS)))
    time.sleep(1.0)
    check.same(f"positions after a motion by {mover.name}", answer(lambda bus: bus.sync_read(POSITION)))
    check.same("states, torque to current", answer(lambda bus: bus.sync_read((40, 31))))


def ping_of_none(bus):
    try:
        return bus.ping(9)
    except Exception:  # each client has errors of its own
        return False


def times(clients, port, examples, rounds):
    for client in clients:
        bus = client(port, examples)
        took = []
        for _ in range(rounds):
            begun = time.perf_counter()
            bus.sync_read((56, 15))
            took.append(1e3 * (time.perf_counter() - begun))
        bus.close()
        took.sort()
        print(f"time  {client.name}: sync read of 15 bytes from six, median {statistics.median(took):.2f} ms, p99 {took[int(0.99 * len(took))]:.2f} ms")


def main():
    a = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    a.add_argument("--examples", default="target/release/examples", help="folder of the built examples `servos` and `registers`")
    a.add_argument("--rounds", type=int, default=200, help="timed reads per client")
    a = a.parse_args()
    clients = [Mobee]
    for client in (Rustypot, FeetechSdk):
        if importlib.util.find_spec(client.module):
            clients.append(client)
        else:
            print(f"SKIPPED: {client.name} is not installed: pip install {client.name}")
    if len(clients) == 1:
        sys.exit("SKIPPED: there is no second opinion")
    with tempfile.TemporaryDirectory() as folder:
        port = os.path.join(folder, "so101")
        servos = subprocess.Popen([os.path.join(a.examples, "servos"), port], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        try:
            servos.stdout.readline()
            check = Check()
            compare(clients, port, a.examples, check)
            times(clients, port, a.examples, a.rounds)
        finally:
            servos.stdin.write("quit\n")
            servos.stdin.close()
            servos.wait(10)
    print(f"{check.made} comparisons of {', '.join(c.name for c in clients)}: {check.differing} differ")
    sys.exit(check.differing > 0)


if __name__ == "__main__":
    main()
