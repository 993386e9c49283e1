"""Writes the seed corpus of all targets from the golden frames: python env-server/fuzz/seed.py"""

import json
from pathlib import Path

FUZZ = Path(__file__).parent
GOLDEN = FUZZ.parents[1] / "docs" / "clients" / "golden.jsonl"


def main() -> None:
    """One file an exchange for `header` and `peer`; growing conversations for `machine`."""
    conversation = b""
    session = None
    for i, line in enumerate(GOLDEN.read_text().splitlines()):
        exchange = json.loads(line)
        frames = [bytes.fromhex(frame) for frame in exchange["request"]]
        session = session or exchange["answers"]["header"]["p"].get("sid")
        if session:
            # The target puts its own session in this place.
            frames = [frame.replace(session.encode(), b"*" * 32) for frame in frames]
        conversation += bytes([len(frames)])
        for frame in frames:
            conversation += len(frame).to_bytes(2, "big") + frame
        # The peer has shaken hands (3). Flags: 2 a length of eight bytes, 1 more frames to come.
        message = b"\x03" + b"".join(
            bytes([2 | (k + 1 < len(frames))]) + len(frame).to_bytes(8, "big") + frame
            for k, frame in enumerate(frames)
        )
        contents = {"header": frames[0] or frames[1], "machine": conversation, "peer": message}
        for target, content in contents.items():
            folder = FUZZ / "corpus" / target
            folder.mkdir(parents=True, exist_ok=True)
            (folder / f"golden-{i:02}").write_bytes(content)


if __name__ == "__main__":
    main()
