"""Prints head motion for the setting `motion`, such as scenes/head.jsonl: a viewer who stands, sways and looks around.

python examples/head_motion.py [SECONDS] > head.jsonl

Each turn of the head is a minimum-jerk movement (Flash & Hogan 1985), u³ (10 - 15 u + 6 u²) for u from 0 to 1; the eyes
sit in front of and above the joint of the neck, so that they move as the head turns; the body sways by two sines in each
direction, a few millimetres each. The gaze is where the head will look, as far as the eyes turn.
"""

import json
import math
import sys

RATE_HZ = 72
# From the neck joint to the point between the eyes, metres.
EYES = (0.0, 0.075, -0.08)
# Begin and duration of each turn in seconds, then its target: yaw to the left and pitch upwards, degrees.
TURNS = [(0.3, 0.6, 25, 4), (1.3, 0.4, 10, -8), (2.0, 0.9, -30, 2), (3.3, 0.5, -12, 10), (4.1, 0.7, 0, 0)]


def angles(t):
    yaw = pitch = 0.0
    for begin, length, to_yaw, to_pitch in TURNS:
        u = min(max((t - begin) / length, 0.0), 1.0)
        share = u**3 * (10 - 15 * u + 6 * u * u)
        yaw, pitch = yaw + (to_yaw - yaw) * share, pitch + (to_pitch - pitch) * share
    return math.radians(yaw), math.radians(pitch)


def rotated(yaw, pitch, v):
    x, y, z = v
    y, z = y * math.cos(pitch) - z * math.sin(pitch), y * math.sin(pitch) + z * math.cos(pitch)
    return x * math.cos(yaw) + z * math.sin(yaw), y, -x * math.sin(yaw) + z * math.cos(yaw)


def sample(t):
    yaw, pitch = angles(t)
    sway = [a * math.sin(t * 2 * math.pi * f + p) + b * math.sin(t * 2 * math.pi * g)
            for a, f, p, b, g in [(8e-3, 0.31, 0.4, 2e-3, 1.1), (3e-3, 0.9, 1.3, 1e-3, 2.3), (6e-3, 0.23, 2.2, 2e-3, 0.8)]]
    at_rest = [sway[i] + rotated(yaw, pitch, EYES)[i] - EYES[i] for i in range(3)]
    a, b = yaw / 2, pitch / 2
    turn = [math.cos(a) * math.sin(b), math.sin(a) * math.cos(b), -math.sin(a) * math.sin(b), math.cos(a) * math.cos(b)]
    soon = angles(t + 0.15)
    gaze = [min(max(0.5 + 0.8 * d, 0.2), 0.8) for d in (yaw - soon[0], pitch - soon[1])]
    rounded = {"time_s": round(t, 6), "position_m": at_rest, "orientation": turn, "gaze": gaze}
    return {name: [round(v, 6) for v in value] if isinstance(value, list) else value for name, value in rounded.items()}


seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 5.0
print(json.dumps({"diptych_motion": 1, "about": "turns and sway by formulas: examples/head_motion.py"}))
for i in range(int(seconds * RATE_HZ) + 1):
    print(json.dumps(sample(i / RATE_HZ)))
