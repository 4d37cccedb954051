#!/usr/bin/env python3
"""Wears the headset of Monado's remote driver, with a controller in each hand.

    python3 tools/remote-headset.py

Each line of its standard input is a step and how many seconds it lasts, such as `ahead 1`: `ahead`, the left thumbstick
is pushed away; `recentre`, the left button B is held; `panel`, the right button A is held; `turn`, the head turns to the
left by a right angle and stays so; `rest`. Each that is over is written, and nothing is held between them. The headset
is worn until the input ends. Its eyes are turned outwards and see further there than inwards.

The driver listens where `P_OVERRIDE_ACTIVE_CONFIG=remote monado-service` runs. It takes packets of one size, little
endian, with all that is known of the headset and of both controllers (`r_interface.h` of Monado 25).
"""

import math
import socket
import struct
import sys
import threading
import time

PORT = 4242
UPRIGHT = (0.0, 0.0, 0.0, 1.0)
FACING_LEFT = (0.0, math.sin(math.pi / 4), 0.0, math.cos(math.pi / 4))
EYES_APART_M = 0.064
OUTWARDS_RAD, INWARDS_RAD, UP_RAD, DOWN_RAD = 0.9, 0.7, 0.75, 0.8
TURNED_OUTWARDS_RAD = 0.09


def pose(orientation, position):
    return struct.pack("<7f", *orientation, *position)


def view(side):
    """Of an eye; `side` is -1 for the left one."""
    left, right = (-OUTWARDS_RAD, INWARDS_RAD) if side < 0 else (-INWARDS_RAD, OUTWARDS_RAD)
    half = TURNED_OUTWARDS_RAD / 2
    eye = pose((0.0, -side * math.sin(half), 0.0, math.cos(half)), (side * EYES_APART_M / 2, 0.0, 0.0))
    return struct.pack("<4f", left, right, UP_RAD, -DOWN_RAD) + eye + bytes(4)


def controller(position, stick_y, a, b):
    velocities, fingers_and_squeeze, trackpad = [0.0] * 6, [0.0] * 8, [0.0] * 3
    # Hand tracked, hand active, two of the system button, A and B each with touch, others.
    buttons = [0, 1, 0, 0, a, 0, b, 0] + [0] * 8
    values = velocities + fingers_and_squeeze + [0.0, stick_y] + trackpad
    return pose(UPRIGHT, position) + struct.pack("<19f16B", *values, *buttons)


def packet(step, facing):
    head = view(-1) + view(1) + pose(facing, (0.0, 1.6, 0.0)) + struct.pack("<B3x", 1)
    left = controller((-0.2, 1.3, -0.3), float(step == "ahead"), 0, step == "recentre")
    right = controller((0.2, 1.3, -0.3), 0.0, step == "panel", 0)
    return b"mndrmt3\0" + head + left + right


class Wearer:
    def __init__(self):
        self.step, self.facing = "rest", UPRIGHT

    def goes_on(self, connection):
        while True:
            connection.sendall(packet(self.step, self.facing))
            time.sleep(0.01)


def main():
    wearer = Wearer()
    connection = socket.create_connection(("127.0.0.1", PORT), timeout=10)
    threading.Thread(target=wearer.goes_on, args=(connection,), daemon=True).start()
    for line in sys.stdin:
        step, seconds = line.split()
        wearer.facing = FACING_LEFT if step == "turn" else wearer.facing
        wearer.step = step
        time.sleep(float(seconds))
        wearer.step = "rest"
        time.sleep(0.5)
        print(step, flush=True)


main()
