"""All the demonstrations: each planned, verified and written to out/ with its replay, a line each; 1 if one fails."""

import json
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
TASKS = {
    "bolt": "bolt/task.yaml",
    "drill": "drill/task.yaml",
    "suction": "suction/task.yaml",
    "suction_turned": "suction/turned.yaml",
    "flip_one_arm": "flip/one_arm.yaml",
    "flip_two_arms": "flip/two_arms.yaml",
    "kitting": "kitting/task.yaml",
    "four_parts": "four_parts/task.yaml",
    "own_robot": "own_robot/task.yaml",
}


def main() -> int:
    out = Path("out")
    out.mkdir(exist_ok=True)
    failed = False
    for name, file in TASKS.items():
        print(f"{name:<15}", end="", flush=True)
        command = [sys.executable, "-m", "kumitate.tasks.cli", "plan", str(HERE / file), "--json"]
        command += ["--output", str(out / f"{name}.json"), "--replay", str(out / f"{name}.html")]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        failed |= done.returncode != 0
        if not done.stdout:  # neither a plan nor a reason
            print(done.stderr)
            continue
        answer = json.loads(done.stdout)
        if "error" in answer:
            print(answer["error"]["message"])
        else:
            print(f"{answer['actions']:>3} actions, {answer['duration']:5.1f} s of motion,", end="")
            print(f" planned in {sum(answer['seconds'].values()):4.1f} s -> {answer['replay']}")
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
