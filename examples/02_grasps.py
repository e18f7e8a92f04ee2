"""Grasps of a part: from a mesh to grasps that are stable and free of collision, the best first."""

import trimesh

import kumitate as km

tee = trimesh.creation.box([60, 20, 20]) + trimesh.creation.box([20, 20, 40]).apply_translation([0, 0, 30])
part = km.Part.from_mesh(tee, unit="mm", density=1200, name="tee")
grasps = km.plan_grasps(part, km.load_hand("robotiq_2f85"))

for stage in grasps.record:
    print(f"{stage.name:<18}{stage.taken:>7} -> {stage.kept:>6}  {dict(stage.dropped)}")
best = grasps[:1]
print(f"{len(grasps)} grasps; the best opens {best.opening[0] * 1e3:.1f} mm, quality {best.quality[0]:.2f}")
print(f"20 that are spread over the part: quality {grasps.thin(20).quality.round(2)}")
