# SPDX-License-Identifier: Apache-2.0
"""Writes ArduPilot's DataFlash logs, by the format's own description (AP_Logger/LogStructure.h)."""

import struct

import numpy as np

HEAD, FMT = b"\xa3\x95", 128
STRUCT = {
    "b": "b", "B": "B", "h": "h", "H": "H", "i": "i", "I": "I", "f": "f", "d": "d", "n": "4s",
    "N": "16s", "Z": "64s", "c": "h", "C": "H", "e": "i", "E": "I", "L": "i", "M": "B", "q": "q",
    "Q": "Q",
}  # fmt: skip
SCALE = dict.fromkeys("cCeE", 100.0)

MESSAGES = {
    "SIDD": ("Qfffffffff", "TimeUS,Time,Targ,F,Gx,Gy,Gz,Ax,Ay,Az"),
    "SIDS": ("QBfffffff", "TimeUS,Ax,Mag,FSt,FSp,TFin,TC,TR,TFout"),
    "RATE": ("Qffffffffffff", "TimeUS,RDes,R,ROut,PDes,P,POut,YDes,Y,YOut,ADes,A,AOut"),
    "ATT": ("QccccCCCCB", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw,ErrRP,ErrYaw,AEKF"),
    "IMU": ("QBffffffIIfBBHH", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz"),
    "XKF1": ("QBccCfffffffccce", "TimeUS,C,Roll,Pitch,Yaw,VN,VE,VD,dPD,PN,PE,PD,GX,GY,GZ,OH"),
    "RCOU": ("QHHHHHHHH", "TimeUS,C1,C2,C3,C4,C5,C6,C7,C8"),
    "RPM": ("QBffB", "TimeUS,I,RPM,Qual,H"),
    "MSG": ("QZ", "TimeUS,Message"),
}
"""Name to types and labels, as ArduPilot Copter 4.x logs them."""


def described(number, name, types, labels):
    """The FMT message of a message."""
    length = 3 + struct.calcsize("<" + "".join(STRUCT[c] for c in types))
    return HEAD + struct.pack(
        "<BBB4s16s64s", FMT, number, length, name.encode(), types.encode(), labels.encode()
    )


def message(number, types, values):
    """A message of these values, in the units of its labels."""
    packed = [
        v if c in "nNZ" else float(v) if c in "fd" else round(float(v) * SCALE.get(c, 1.0))
        for c, v in zip(types, values, strict=True)
    ]
    return HEAD + bytes([number]) + struct.pack("<" + "".join(STRUCT[c] for c in types), *packed)


def log(tables):
    """A whole log, its messages in the order of their times.

    tables: name of `MESSAGES` to its columns by label, time in us among them; what is left out
    is 0.
    """
    parts = [described(FMT, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns")]
    numbers = {name: 10 + i for i, name in enumerate(MESSAGES)}
    parts += [described(numbers[name], name, *MESSAGES[name]) for name in tables]
    rows = []
    for name, columns in tables.items():
        types, labels = MESSAGES[name]
        names = labels.split(",")
        for k in range(len(columns["TimeUS"])):
            values = [
                columns[n][k] if n in columns else b"" if c in "nNZ" else 0
                for n, c in zip(names, types, strict=True)
            ]
            rows.append((columns["TimeUS"][k], len(rows), message(numbers[name], types, values)))
    return b"".join(parts + [row[2] for row in sorted(rows)])


def times_us(count, rate_hz, start_s=3.0):
    """(count,) whole microseconds."""
    return np.round((start_s + np.arange(count) / rate_hz) * 1e6).astype(np.int64)
