"""One renderer in a process of its own, which stays there for a scene's whole comparison.

    worker.py MODULE OPTIONS.json

Requests come as lines of JSON on stdin, answers go as lines of JSON to what was stdout. Whatever the renderer prints
itself goes to stderr.
"""

import importlib
import json
import os
import sys
import time
import traceback
from pathlib import Path

import numpy as np

import gltf


def sky_of(sky):
    """`Flat.sky` of what a request says: a colour, the path of an array of texels, or None."""
    if isinstance(sky, str):
        return np.load(sky)
    return None if sky is None else tuple(sky)


def answer(peer, request):
    what = request["do"]
    if what == "load":
        flat = gltf.flatten(request["scene"], sky_of(request["sky"]))
        cannot = peer.cannot(flat)
        if cannot is not None:
            return {"cannot": cannot}
        return {"build": peer.load(flat, request["size"]), "triangles": flat.triangle_count()}
    if what == "prepare":
        peer.prepare(request["spps"])
        return {}
    start = time.monotonic()
    picture, seconds, spp = peer.render(request["spp"], request["seed"])
    overhead = max(time.monotonic() - start - seconds, 0.0)
    np.save(request["picture"], np.ascontiguousarray(picture, np.float32))
    return {"seconds": seconds, "spp": spp, "overhead": overhead}


def main():
    out = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    sys.path.insert(0, str(Path(__file__).parent))
    peer = importlib.import_module(sys.argv[1]).Peer(**json.loads(sys.argv[2]))
    print(json.dumps({"version": peer.version}), file=out, flush=True)
    for line in sys.stdin:
        try:
            answered = answer(peer, json.loads(line))
        except gltf.NotExact as error:
            answered = {"cannot": str(error)}
        except Exception as error:
            traceback.print_exc()
            answered = {"error": f"{type(error).__name__}: {error}"}
        print(json.dumps(answered), file=out, flush=True)


if __name__ == "__main__":
    main()
