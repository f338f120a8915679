import sys, numpy as np
from concurrent.futures import ProcessPoolExecutor
from heli_flight import loop as closed_loop
from heli_flight.layers import NODES
from heli_flight.settings import resolve

STAYS = {"climb.start_s": 200.0, "climb.end_s": 202.0}


def fault(kind, value, topic="any"):
    over = "" if topic == "any" else f"topic: {topic}, "
    return f"{{what: link, from: any, to: any, {over}kind: {kind}, value: {value}, start_s: 12.0}}"


G = {"old": (4.3, 8.2, 5.6, 0.0), "C": (7.5, 15.0, 5.1, 0.04)}


def fly(args):
    name, seed, gps, kind = args
    kp, kd, bw, th = G[name]
    outer = {
        "K_P": [1.2, 1.2, kp],
        "K_D": [2.2, 2.7, kd],
        "disturbance.bandwidth_radps": [1.3, 2.0, bw],
        "collective_prediction_s": th,
    }
    recs = []
    for faults in (
        (),
        {"mix": (fault("loss", 0.2), fault("delay", 0.03)), "late": (fault("delay", 0.1, "odom"),)}[
            kind
        ],
    ):
        over = {node.name: {"link_faults": tuple(faults) or ("none",)} for node in NODES}
        over["outer_loop"] = over["outer_loop"] | outer
        s = resolve("hover", gps, seed, 40.0, world="honest", overrides=over | {"scenario": STAYS})
        l = closed_loop.build(s)
        f = closed_loop.fly_loop(l, s)
        if f.status != 0:
            return name, gps, kind, 99.0, 99.0
        recs.append(f.record.truth_pos_ned_m)
    d = np.abs(recs[1] - recs[0])
    return name, gps, kind, np.linalg.norm(recs[1] - recs[0], axis=1).max(), d[:, 2].max()


if __name__ == "__main__":
    seeds = range(121, 181)
    jobs = [
        (n, s, g, k) for n in G for g, k in (("rtk", "mix"), ("standalone", "mix")) for s in seeds
    ]
    with ProcessPoolExecutor(2) as ex:
        rows = list(ex.map(fly, jobs, chunksize=10))
    for n in G:
        for g, k in (("rtk", "mix"), ("standalone", "mix")):
            v = np.array([r[3:] for r in rows if r[:3] == (n, g, k)])
            lim = {"rtkmix": 1.0, "standalonemix": 3.0, "rtklate": 0.3}[g + k]
            print(
                n,
                g,
                k,
                "lost",
                int((v[:, 0] > 90).sum()),
                "beyond",
                int((v[:, 0] > lim).sum()),
                "median",
                np.median(v, axis=0).round(3),
                "q90",
                np.quantile(v, 0.9, axis=0).round(2),
                flush=True,
            )
