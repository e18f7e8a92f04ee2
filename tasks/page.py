"""One HTML file with meshcat's viewer inside: it opens in a browser, offline and without a server."""

from __future__ import annotations

import base64
import gzip
import uuid
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

import meshcat
import meshcat.geometry as shapes
import numpy as np
import numpy.typing as npt
import umsgpack

from ..transforms import Array

Command = dict[str, Any]
_PAGE = """<!DOCTYPE html>
<html><head><meta charset="utf-8"><title>{title}</title><style>
body {{ margin: 0; font: 14px/1.5 system-ui, sans-serif; color: #222; }}
#view {{ position: absolute; inset: 0 0 0 33em; overflow: hidden; }}
#panel {{ position: absolute; inset: 0 auto 0 0; width: 31em; overflow: auto; padding: 10px 1em; }}
#panel h1 {{ font-size: 16px; margin: 0 0 6px; }} #panel table {{ border-collapse: collapse; }}
#panel td, #panel th {{ padding: 0 8px 0 0; text-align: right; font-variant-numeric: tabular-nums; }}
#panel td:first-child, #panel td:last-child {{ text-align: left; }} #panel label {{ display: block; }}
</style></head><body><div id="view"></div><div id="panel">{panel}</div>
<script>{viewer}</script><script>
const viewer = new MeshCat.Viewer(document.getElementById("view"));
viewer.gui.domElement.style.display = "none";
const show = (path, value) => viewer.handle_command(
  {{type: "set_property", path: "/meshcat/" + path, property: "visible", value: value}});
const unpack = async text => {{
  const packed = Uint8Array.from(atob(text), c => c.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}};
(async () => {{
  const bytes = await unpack("{commands}");
  const sizes = new DataView(bytes.buffer);
  for (let at = 0; at < bytes.length;) {{
    const size = sizes.getUint32(at, true);
    viewer.handle_command_bytearray(bytes.slice(at + 4, at + 4 + size));
    at += 4 + size;
  }}
  for (const box of document.querySelectorAll("input[data-path]")) {{
    box.onchange = () => show(box.dataset.path, box.checked);
    box.onchange();
  }}
  {{
    {script}
  }}
  window.pageReady = true;
}})();
</script></body></html>
"""


def write_page(path: str | Path, title: str, panel: str, commands: Sequence[Command], script: str = "") -> None:
    """Write the page.

    Args:
        path: The HTML file.
        title: Title of the page, as HTML text.
        panel: HTML beside the scene; an ``<input type="checkbox" data-path="hands">`` shows and hides that path.
        commands: Commands of meshcat, in order.
        script: JavaScript that runs once the scene stands: ``viewer`` is meshcat's, ``unpack`` reads `packed` text.
    """
    viewer = files(meshcat).joinpath("viewer/dist/main.min.js").read_text(encoding="utf-8")
    viewer = viewer.replace("</script", "<\\/script")
    page = _PAGE.format(title=title, panel=panel, viewer=viewer, commands=packed_commands(commands), script=script)
    Path(path).write_text(page, encoding="utf-8", errors="replace")  # names of files need not be text


def packed(data: bytes) -> str:
    """``data`` as text that a page can hold."""
    return base64.b64encode(gzip.compress(data, 6, mtime=0)).decode()


def packed_commands(commands: Sequence[Command]) -> str:
    """Commands of meshcat, in order, as text that a page can hold."""
    encoded = [umsgpack.packb(command) for command in commands]
    return packed(b"".join(len(data).to_bytes(4, "little") + data for data in encoded))


def backdrop() -> list[Command]:
    """Commands for a plain, light background without grid and axes."""
    settings = [
        ("/Grid", "visible", False),
        ("/Axes", "visible", False),
        ("/Background", "top_color", [1.0, 1.0, 1.0]),
        ("/Background", "bottom_color", [0.85, 0.87, 0.9]),
    ]
    return [{"type": "set_property", "path": path, "property": name, "value": value} for path, name, value in settings]


def mesh_geometry(vertices: Array, faces: npt.NDArray[np.int64]) -> Command:
    """The triangles of ``faces`` (n, 3), which may be some of a mesh; they have no normals and are shaded flat."""
    used, corners = np.unique(faces, return_inverse=True)
    lowered = point_geometry(np.asarray(vertices)[used])
    lowered["data"]["index"] = shapes.pack_numpy_array(corners.reshape(-1, 3).astype(np.uint32).T)
    return lowered


def point_geometry(points: Array) -> Command:
    """Points, or ends of line segments two by two (n, 3)."""
    lowered: Command = shapes.PointsGeometry(np.asarray(points, dtype=np.float32).T).lower({})
    return lowered


def material(color: int, *, opacity: float = 1.0, kind: str = "MeshPhongMaterial", **more: Any) -> Command:
    """A material of three.js."""
    see_through = {"transparent": opacity < 1.0, "opacity": opacity, "depthWrite": opacity >= 1.0}
    look = {"type": kind, "color": color, "side": 2, "flatShading": True}
    return {"uuid": str(uuid.uuid4()), **look, **see_through, **more}


def group(path: str, items: Sequence[tuple[str, Command, Command, Array]]) -> Command:
    """The command that puts items at a path, each (three.js class, geometry, material, pose (4, 4)).

    Items may share geometries and materials: each is sent once, so that a thousand hands cost a thousand poses.
    """
    geometries = {geometry["uuid"]: geometry for _, geometry, _, _ in items}
    materials = {used["uuid"]: used for _, _, used, _ in items}
    children = [
        {
            "uuid": str(uuid.uuid4()),
            "type": kind,
            "geometry": geometry["uuid"],
            "material": used["uuid"],
            "matrix": [float(x) for x in np.asarray(pose).T.ravel()],
        }
        for kind, geometry, used, pose in items
    ]
    body = {"uuid": str(uuid.uuid4()), "type": "Group", "matrix": np.eye(4).ravel().tolist(), "children": children}
    content = {
        "metadata": {"version": 4.5, "type": "Object"},
        "geometries": list(geometries.values()),
        "materials": list(materials.values()),
        "object": body,
    }
    return {"type": "set_object", "path": f"/meshcat/{path}", "object": content}
