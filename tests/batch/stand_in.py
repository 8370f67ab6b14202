"""Takes the place of ar-replace where a job's work is not the point: --codec says what it shall do, quickly.

Its output has its input and ad in it, and appears at once, as that of ar-replace. It ends with its parent.
"""

import json
import os
import signal
import sys
import time
from threading import Thread


def end_with_parent() -> None:
    os.read(0, 1)
    os._exit(1)


Thread(target=end_with_parent, daemon=True).start()
words = [word for word in sys.argv[1:] if word.startswith("/")]
given = {word[2:].partition("=")[0]: word.partition("=")[2] for word in sys.argv[1:] if word.startswith("--")}
output, (codec, _, seconds) = given["output"], given.get("codec", "").partition(":")
notes = os.path.dirname(words[0]) + "/begun.txt"
with open(notes, "a") as file:
    file.write(os.path.basename(output) + "\n")
with open(notes) as file:
    tries = file.read().split().count(os.path.basename(output))
if codec == "wrong":
    print("error: that cannot be", file=sys.stderr)
    sys.exit(2)
if codec == "fail" or (codec == "fail-once" and tries == 1):
    print("error: it broke", file=sys.stderr)
    sys.exit(1)
if codec == "crash-once" and tries == 1:
    os.kill(os.getpid(), signal.SIGSEGV)
if codec == "memory":
    held = bytearray(300 << 20)
    held[:] = bytes([1]) * len(held)
time.sleep(float(seconds or 0.05))
with open(output + ".part", "w") as file:
    for word in [*words, *([given["track"]] if "track" in given and codec == "tracked" else [])]:
        with open(word) as source:
            file.write(source.read() + "\n")
os.replace(output + ".part", output)
if "save-track" in given and codec == "tracked":
    with open(given["save-track"], "w") as file:
        file.write("a track")
if codec == "doubt":
    print(json.dumps({"output": output, "verdict": {"status": "check", "reasons": ["12 % held"]}}))
    sys.exit(4)
print(json.dumps({"output": output, "states": {"tracked": 3, "lost": 1}, "warnings": ["<odd> & \x01"]}))
