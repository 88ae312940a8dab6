"""Made recordings of an arm that moves from stand to stand, and files of its joints."""

import numpy as np

HEADER = """\
robot: irb1600
tool: {kind: probe, calibrated: false, point_mm: [0, 0, 100]}
noise: {joint_deg: 0.01, spot_mm: 0.5}
"""
# Degrees; every joint moves between two of them.
POSTURES = np.array(
    [
        [10.0, 20.0, -30.0, 40.0, 50.0, -60.0],
        [-12.0, 31.0, -20.0, 55.0, 40.0, -75.0],
        [25.0, 5.0, -44.0, 70.0, 65.0, -20.0],
        [40.0, 15.0, -10.0, 20.0, 30.0, 15.0],
    ]
)


def moves(postures=POSTURES, stand_s=1.0, move_s=0.6, rate=50.0, noise_deg=0.0, seed=0):
    """Times (N,) s and joints (N, 6) degrees: stands, and smooth moves to, between and from them."""
    step = 1 / rate
    ramp = (1 - np.cos(np.pi * np.arange(step, move_s, step) / move_s)) / 2
    still = np.zeros(round(stand_s * rate) + 1)
    away = postures[0] + 30
    parts = []
    for before, after in zip([away, *postures], [*postures, away], strict=True):
        parts.append(before + ramp[:, None] * (after - before))
        parts.append(after + still[:, None])
    joints = np.concatenate(parts[:-1])
    joints += np.random.default_rng(seed).normal(0, noise_deg, joints.shape)
    return np.arange(len(joints)) * step, joints


def table(columns, rows, sign):
    lines = [] if columns is None else [sign.join(columns)]
    return "\n".join([*lines, *(sign.join(map(str, row)) for row in rows)]) + "\n"


def ur(times, joints_deg, marker=None):
    """As the CSV writer of the RTDE client does; `bit` is the marker, and target_q is not what was read."""
    names = ["timestamp", *(f"{which}_q_{i}" for which in ("target", "actual") for i in range(6)), "bit"]
    joints = np.radians(joints_deg)
    bits = np.zeros(len(times), int) if marker is None else marker
    rows = [
        [4000 + time, *(np.array(row) + 0.1), *row, bit]
        for time, row, bit in zip(times, joints.tolist(), bits, strict=True)
    ]
    return table(names, rows, " ")


def fanuc_position(number, row, comment="", more=""):
    values = [f"J{i + 1}= {value:9.3f} deg" for i, value in enumerate(row)]
    name = f'{number}:"{comment}"' if comment else number
    joints = f"\t{','.join(values[:3])},\n\t{','.join(values[3:])}\n"
    return f"P[{name}]{{\n   GP1:\n\tUF : 0, UT : 1,\t\n{joints}{more}}};\n"


def fanuc_listing(positions):
    moves = "   1:J P[1] 100% FINE    ;\n"
    return f"/PROG  SHOTS\n/ATTR\nLINE_COUNT = 1;\n/MN\n{moves}/POS\n{positions}/END\n"


def kuka_point(name, row, kind="E6AXIS", ends=",E1 0.0,E2 0.0,E3 0.0,E4 0.0,E5 0.0,E6 0.0}"):
    axes = ",".join(f"A{i + 1} {value:.5f}" for i, value in enumerate(row))
    return f"DECL {kind} {name}={{{axes}{ends}\n"


def kuka_list(points):
    begin = "&ACCESS RVP\n&REL 1\nDEFDAT  SHOTS\n;a comment {A1 5}\n"
    return f"{begin}{points}DECL FDAT FP1={{TOOL_NO 1}}\nENDDAT\n"
