"""Bundle three.js for the page of `tfdb view`: `python tools/make_three.py [VERSION]`.

Takes npm's package `three` with OrbitControls and lines of a width in pixels, bundles them by
esbuild, and writes `src/tfdb/view/page/three.js` with version and licence. The file is committed.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

PAGE = Path(__file__).resolve().parent.parent / "src" / "tfdb" / "view" / "page"
VERSION = "0.187.0"
ESBUILD = "0.28.2"
NAMES = [
    "BoxGeometry",
    "BufferAttribute",
    "BufferGeometry",
    "Color",
    "CylinderGeometry",
    "DirectionalLight",
    "DoubleSide",
    "GridHelper",
    "HemisphereLight",
    "Matrix4",
    "Mesh",
    "MeshLambertMaterial",
    "PerspectiveCamera",
    "Points",
    "PointsMaterial",
    "Quaternion",
    "Scene",
    "SphereGeometry",
    "Vector3",
    "WebGLRenderer",
]
"""What the page uses of three's own module."""
ADDONS = {
    "OrbitControls": "controls/OrbitControls.js",
    "LineMaterial": "lines/LineMaterial.js",
    "LineSegments2": "lines/LineSegments2.js",
    "LineSegmentsGeometry": "lines/LineSegmentsGeometry.js",
}


def run(*command: str, cwd: str) -> None:
    """Run a program; it must succeed."""
    subprocess.run(command, cwd=cwd, check=True, stdout=subprocess.DEVNULL)


def main() -> None:
    """Fetch, bundle, write."""
    version = sys.argv[1] if len(sys.argv) > 1 else VERSION
    with tempfile.TemporaryDirectory() as folder:
        packages = [f"three@{version}", f"esbuild@{ESBUILD}"]
        run("npm", "install", "--no-audit", "--no-fund", *packages, cwd=folder)
        lines = [f"export {{ {', '.join(NAMES)} }} from 'three';"]
        lines += [
            f"export {{ {name} }} from 'three/addons/{path}';" for name, path in ADDONS.items()
        ]
        Path(folder, "page.js").write_text("\n".join(lines))
        program = "node_modules/.bin/esbuild"
        # The add-ons import 'three' as well: all must be one module.
        alias = "--alias:three=./node_modules/three/build/three.module.js"
        addons = "--alias:three/addons=./node_modules/three/examples/jsm"
        options = ["--bundle", "--minify", "--format=esm", "--legal-comments=none"]
        out = Path(folder, "out.js")
        run(program, "page.js", *options, alias, addons, f"--outfile={out}", cwd=folder)
        licence = Path(folder, "node_modules/three/LICENSE").read_text().strip()
        text = out.read_text()
    head = f"/* three.js {version}, bundled by tools/make_three.py\n\n{licence}\n*/\n"
    (PAGE / "three.js").write_text(head + text)
    print(f"three.js {version}: {len(text):,} bytes")


if __name__ == "__main__":
    main()
