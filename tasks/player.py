"""What moves a replay page: its style, its controls, and the script behind them.

The motion stands in the page as rows of whole numbers: the times, then seven rows a body for position and quaternion,
each as second differences in units of ``QUANTUM``, with the sign in the lowest bit, all lowest bytes first: most others
are zero. Between two moments bodies go straight on.
``window.replay`` is its handle from outside: ``time``, ``duration``, ``playing``, ``speed``; ``seek(time)``,
``play()``, ``pause()``; ``poseOf(name)``, position and quaternion in the world; ``camera(position, target)``.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from ..errors import InputError
from ..transforms import Array
from .page import packed

QUANTUM = 1e-5  # s, m and shares of a unit quaternion: a hundredth of a millimetre half a metre from the axis

STYLE = """<style>
#panel { display: flex; flex-direction: column; overflow: hidden; padding-bottom: 0; background: #fff; }
#panel p { margin: 0 0 8px; color: #667; }
#panel button { font: inherit; border: 1px solid #c5cad3; border-radius: 5px; background: #f6f7f9; cursor: pointer; }
#panel button.on { background: #1f6feb; border-color: #1f6feb; color: #fff; }
#bar { display: flex; align-items: center; gap: 4px; }
#play { width: 5.5em; padding: 4px 0; font-weight: 600 !important; }
#clock { flex: 1; text-align: center; font-variant-numeric: tabular-nums; }
#slider { width: 100%; margin: 10px 0; }
#steps { flex: 1; overflow: auto; margin: 0; padding: 0; list-style: none; border-top: 1px solid #e3e6eb; }
#steps li { display: flex; gap: 10px; padding: 5px 8px; border-bottom: 1px solid #eef0f3; cursor: pointer;
  scroll-margin: 5em; }
#steps li:hover { background: #f3f5f8; }
#steps li.now { background: #dceaff; box-shadow: inset 3px 0 #1f6feb; }
#steps li :first-child { width: 1.6em; text-align: right; color: #8a93a0; }
#steps li :nth-child(2) { flex: 1; }
#steps time { color: #667; white-space: nowrap; font-variant-numeric: tabular-nums; }
#legend { padding: 8px 0; border-top: 1px solid #e3e6eb; }
#legend label { display: inline-block; margin-right: 12px; white-space: nowrap; }
#legend b { font-size: 17px; }
</style>"""

CONTROLS = """<div id="bar"><button id="play">Play</button><span id="clock"></span>
<button data-speed="0.25">&frac14;</button><button data-speed="0.5">&frac12;</button><button data-speed="1">1</button>
<button data-speed="2">2</button><button data-speed="4">4&times;</button></div>
<input id="slider" type="range" min="0" step="any">"""

_SCRIPT = """
const film = @film@, bytes = await unpack("@motion@"), count = bytes.length / 4;
const bodies = film.paths.map(path => viewer.scene_tree.find(["meshcat", ...path.split("/")]).object);
const frames = count / (1 + 7 * bodies.length), table = new Float64Array(count);
for (let row = 0; row < count; row += frames)
  for (let i = row, step = 0, value = 0; i < row + frames; i++) {
    const bits = bytes[i] | bytes[i + count] << 8 | bytes[i + 2 * count] << 16 | bytes[i + 3 * count] << 24;
    table[i] = @quantum@ * (value += step += (bits >>> 1) ^ -(bits & 1));
  }

const [play, clock, slider] = ["play", "clock", "slider"].map(id => document.getElementById(id));
const steps = [...document.querySelectorAll("#steps li")], speeds = [...document.querySelectorAll("[data-speed]")];
const duration = table[frames - 1];
let time = 0, speed = 1, playing = false, current;

const draw = () => {
  let low = 0, high = frames - 1;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (table[middle] <= time) low = middle; else high = middle;
  }
  const share = (time - table[low]) / (table[high] - table[low] || 1);
  bodies.forEach((body, i) => {
    const at = k => {
      const row = (1 + 7 * i + k) * frames;
      return table[row + low] + share * (table[row + high] - table[row + low]);
    };
    body.position.set(at(0), at(1), at(2));
    body.quaternion.set(at(3), at(4), at(5), at(6)).normalize();
  });
  viewer.set_dirty();
  slider.value = time;
  clock.textContent = `${time.toFixed(1)} of ${duration.toFixed(1)} s`;
  const step = steps.findLast(item => +item.dataset.start <= time + 1e-6);
  if (step !== current) {
    if (current) current.classList.remove("now");
    current = step;
    current.classList.add("now");
    current.scrollIntoView({block: "nearest"});
  }
};
const run = value => {
  playing = value;
  play.textContent = playing ? "Pause" : "Play";
  play.classList.toggle("on", playing);
};
const pace = value => {
  speed = value;
  for (const button of speeds) button.classList.toggle("on", +button.dataset.speed === speed);
};
const turned = ([x, y, z]) => [x, z, -y];  // what draws has y up
let last = 0;
const tick = now => {
  requestAnimationFrame(tick);
  const passed = (now - last) / 1000;
  last = now;
  if (!playing) return;
  time = Math.min(time + speed * passed, duration);
  if (time === duration) run(false);
  draw();
};
window.replay = {
  get time() { return time; },
  get duration() { return duration; },
  get playing() { return playing; },
  get speed() { return speed; },
  set speed(value) { pace(value); },
  seek(value) { time = Math.max(0, Math.min(value, duration)); draw(); },
  play() { if (time === duration) this.seek(0); run(true); },
  pause() { run(false); },
  poseOf(name) {
    const body = bodies[film.names.indexOf(name)];
    return {position: body.position.toArray(), quaternion: body.quaternion.toArray()};
  },
  camera(position, target) {
    viewer.camera.position.set(...turned(position));
    viewer.controls.target.set(...turned(target));
    viewer.controls.update();
    viewer.set_dirty();
  },
};
play.onclick = () => playing ? replay.pause() : replay.play();
slider.max = duration;
slider.oninput = () => replay.seek(+slider.value);
for (const step of steps) step.onclick = () => replay.seek(+step.dataset.start);
for (const button of speeds) button.onclick = () => pace(+button.dataset.speed);
document.onkeydown = event => {
  if (event.code !== "Space" || event.target.type === "checkbox") return;
  event.preventDefault();
  play.onclick();
};
viewer.camera.fov = @angle@;
replay.camera(film.camera, film.target);
pace(1);
draw();
requestAnimationFrame(tick);
"""


def player_script(
    names: Sequence[str], paths: Sequence[str], motion: str, camera: Array, target: Array, angle: float
) -> str:
    """The script of a replay page.

    Args:
        names: Names of the bodies.
        paths: Their paths in the scene.
        motion: Their motion, as `packed_motion` gives it.
        camera: Where the camera stands at first (3,) [m].
        target: What it looks at (3,) [m].
        angle: Its vertical field of view [deg].
    """
    film = {"names": list(names), "paths": list(paths), "camera": camera.tolist(), "target": target.tolist()}
    values = {
        "film": json.dumps(film).replace("<", "\\u003c"),  # no name ends the script
        "motion": motion,
        "quantum": repr(QUANTUM),
        "angle": repr(angle),
    }
    return re.sub("@(film|motion|quantum|angle)@", lambda found: values[found[1]], _SCRIPT)


def packed_motion(times: Array, poses: Array) -> str:
    """What the script reads, as text: bodies at poses (n, bodies, 4, 4) in the world at ``times`` (n,) [s].

    Raises:
        InputError: A pose is not finite, or a step from one moment to the next is too large for it.
    """
    if not np.isfinite(poses).all():
        raise InputError("plan", "something goes beyond all numbers", "plan the task again")
    n, bodies = poses.shape[:2]
    quaternions = Rotation.from_matrix(poses[..., :3, :3].reshape(-1, 3, 3)).as_quat().reshape(n, bodies, 4)
    turned = (quaternions[1:] * quaternions[:-1]).sum(axis=-1, keepdims=True) < 0.0
    quaternions[1:] *= np.cumprod(np.where(turned, -1.0, 1.0), axis=0)  # the sign that is nearer to the one before
    rows = np.vstack([times, np.concatenate([poses[..., :3, 3], quaternions], axis=-1).reshape(n, -1).T])
    counts = np.rint(rows / QUANTUM)
    steps = np.diff(counts, n=2, axis=1, prepend=np.zeros((len(counts), 2)))
    if not np.abs(steps).max() < 2**31:
        raise InputError("plan", "something moves kilometres, or for hours, in one moment", "plan the task again")
    steps = steps.astype(np.int32)
    bits = (steps << 1) ^ (steps >> 31)
    return packed(bits.astype("<i4").reshape(-1).view(np.uint8).reshape(-1, 4).T.tobytes())
