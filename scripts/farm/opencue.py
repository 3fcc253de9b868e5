#!/usr/bin/env python3
"""An outline for OpenCue: a layer that renders chunks of frames, and one that joins them when all are there.

    opencue.py SCENE FOLDER FIRST LAST CHUNK OUT [FLAGS OF iprt render]

It needs OpenCue's own pyoutline on the machine that submits, and iprt and ffmpeg on those that render, which must see
SCENE, FOLDER and OUT under the same names.
"""

import sys

import outline
import outline.cuerun
import outline.modules.shell


def main() -> None:
    if len(sys.argv) < 7:
        sys.exit(__doc__)
    scene, folder, first, last, chunk, out, *flags = sys.argv[1:]
    job = outline.Outline("iprt", frame_range=f"{first}-{last}", name_unique=True)
    # OpenCue calls a layer once for each chunk, and puts its ends in place of the words in #…#.
    frames = "#FRAME_START#..#FRAME_END#"
    render = outline.modules.shell.Shell(
        "render",
        command=["iprt", "render", scene, "-o", f"{folder}/frame_%06d.png", "--frames", frames, "--warmup", "auto", *flags],
        chunk=int(chunk),
        range=f"{first}-{last}",
    )
    join = outline.modules.shell.Shell(
        "join",
        command=["iprt", "join", folder, "-o", out, "--scene", scene, "--frames", f"{first}..{last}"],
        range="1",
    )
    join.depend_all(render)
    job.add_layer(render)
    job.add_layer(join)
    outline.cuerun.launch(job, use_pycuerun=False)


if __name__ == "__main__":
    main()
