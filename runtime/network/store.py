"""The cache on this machine: where bundles and downloads lie, how a bundle gets in, and which one is the default."""

import os
import re
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.resources import files
from pathlib import Path
from urllib.parse import quote

import platformdirs

from edgemap.runtime.frames.errors import BundleError
from edgemap.runtime.frames.reading import user_path, without_secrets
from edgemap.runtime.network.download import download
from edgemap.runtime.network.manifest import Manifest
from edgemap.runtime.network.manifest_file import MANIFEST_NAME, read_manifest, verified_file

BUNDLE_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,99}")
RENDERED, LENS = "edgemap-nano", "edgemap-pico"
SIMULATION_FILE = "simulation.json"  # lies in what `edgemap simulate` writes


def cache_folder() -> Path:
    """`$EDGEMAP_CACHE`, or the user's cache folder for edgemap."""
    return Path(os.environ.get("EDGEMAP_CACHE") or platformdirs.user_cache_path("edgemap"))


def bundle_folder(name: str) -> Path:
    """The path that a `--bundle` text means: a folder that holds a bundle, a file, any path, or a name.

    A name is looked up among the bundles that come with the package, then in the cache, where one of a shipped name may
    belong to an earlier version.
    """
    path = user_path(name)
    if path.is_file() or (path / MANIFEST_NAME).is_file() or not BUNDLE_NAME.fullmatch(name):
        return path
    shipped = shipped_folder() / name
    return shipped if (shipped / MANIFEST_NAME).is_file() else cache_folder() / "bundles" / name


def install_folder(folder: Path) -> Path:
    """Copy a finished bundle into the cache under its name, every file checked. Raises BundleError."""
    return _install(
        folder, folder, lambda manifest, name, to: shutil.copyfile(verified_file(folder, manifest, name), to)
    )


def install_url(url: str) -> Path:
    """Fetch a finished bundle from the folder at `url` (or its bundle.json) into the cache, every file checked.

    Raises BundleError or DownloadError; the cache is left as it was.
    """
    base = url.removesuffix(MANIFEST_NAME).rstrip("/")

    def fetch(manifest: Manifest, name: str, to: Path) -> None:
        download(f"{base}/{quote(name)}", to, sums=(manifest.sha256[name],))

    with tempfile.TemporaryDirectory() as name:
        page = download(f"{base}/{MANIFEST_NAME}", Path(name) / MANIFEST_NAME, progress=False)
        return _install(page.parent, url, fetch)


def _install(folder: Path, source: Path | str, fetch: Callable[[Manifest, str, Path], object]) -> Path:
    """The bundle whose bundle.json is in a folder at its place in the cache, that folder where it is there already.
    source: for messages. fetch: brings a file of this name, checked, to a path."""
    manifest = read_manifest(folder)
    if not BUNDLE_NAME.fullmatch(manifest.name):
        raise BundleError(f"bundle {source}: its name {manifest.name!r} is no file name")
    target = cache_folder() / "bundles" / manifest.name
    if target.resolve() == folder.resolve():
        return target
    with staged(target) as stage:
        for name in manifest.sha256:
            try:
                (stage / name).parent.mkdir(parents=True, exist_ok=True)
                fetch(manifest, name, stage / name)
            except OSError as error:
                raise BundleError(f"{stage / name}: cannot be written ({error.strerror or error})") from None
        shutil.copyfile(folder / MANIFEST_NAME, stage / MANIFEST_NAME)
    return target


def check_place(target: Path) -> None:
    """Raises BundleError where something other than a bundle or an empty folder is at `target`."""
    if target.exists() and not (target.is_dir() and (not any(target.iterdir()) or (target / MANIFEST_NAME).is_file())):
        raise BundleError(f"{target} exists and is no bundle: left alone")


@contextmanager
def staged(target: Path) -> Iterator[Path]:
    """An empty folder next to `target` that replaces it by one rename when the block succeeds and is removed otherwise.
    Raises BundleError where `target` exists and is not a bundle; it is never overwritten.
    """
    check_place(target)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        folder = Path(tempfile.mkdtemp(prefix=f".{target.name}.", dir=target.parent))
        stage, old = folder / "new", folder / "old"
        stage.mkdir()
    except OSError as error:
        raise BundleError(f"{target}: cannot be written ({error.strerror})") from None
    try:
        yield stage
        if target.exists():
            target.rename(old)
        stage.rename(target)
    finally:
        if old.exists() and not target.exists():
            old.rename(target)
        shutil.rmtree(folder, ignore_errors=True)


def shipped_folder() -> Path:
    """The folder of the bundles that come with the package."""
    return Path(str(files("edgemap.models")))


def shipped_bundles() -> list[str]:
    """Names of the bundles that come with the package, the default ones first."""
    names = (path.parent.name for path in shipped_folder().glob(f"*/{MANIFEST_NAME}"))
    return sorted(names, key=lambda name: (name not in (LENS, RENDERED), name))


def default_bundle(*specs: str) -> tuple[str, str]:
    """The bundle's name for sources `SPEC...`, and why: `edgemap-nano` only where every one of them is rendered.

    `demo`, `sim:SEED` and what `edgemap simulate` wrote count as rendered, as does a `drive:DIR` that is not here. A
    recording counts as what it was recorded from: pass that.
    """
    real = next((spec for spec in specs if not _is_rendered(spec)), None)
    if real is None:
        return RENDERED, f"trained for rendered pictures, as those of {without_secrets(', '.join(specs[:3]))}"
    return LENS, f"trained for real cameras, as {without_secrets(real)} is"


def _is_rendered(spec: str) -> bool:
    kind, _, name = spec.partition(":")
    folder = user_path(name)
    written = bool(name) and (folder / SIMULATION_FILE).is_file()
    return spec == "demo" or kind == "sim" or written or (kind == "drive" and not folder.is_dir())
