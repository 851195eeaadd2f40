"""`edgemap pull`: known models and finished bundles, into the cache."""

from contextlib import suppress
from pathlib import Path
from typing import Annotated

import tyro

from edgemap.cli.arguments import arg
from edgemap.export.sources import KNOWN
from edgemap.runtime.frames.errors import BundleError
from edgemap.runtime.frames.extras import need
from edgemap.runtime.frames.reading import print_message, user_path


def command(
    source: Annotated[
        str,
        tyro.conf.Positional,
        arg(
            metavar="NAME|URL|FOLDER",
            help="yolov3-tiny, yolov3, yolox-nano or picodet-s (needs the extra 'export'); or a finished bundle: its "
            "folder, or the URL of one (needs nothing).",
        ),
    ],
    given: Annotated[
        str | None,
        arg(name="from", metavar="FILE|URL", help="The model's file, for machines that reach no source."),
    ] = None,
) -> None:
    """Fetch a model into the cache, ready to run.

    Upstream is tried first, then mirrors; every file's SHA-256 is checked before anything reads it.
    """
    from edgemap.runtime.network.download import is_url
    from edgemap.runtime.network.store import install_folder, install_url

    if is_url(source):
        if source.startswith("http:"):
            print_message(
                f"{source}: plain http has no authenticity: whoever is on the way can send another bundle; its sums "
                "only show that it arrived complete"
            )
        folder = install_url(source)
    elif source not in KNOWN and user_path(source).exists():
        folder = install_folder(user_path(source))
    else:
        folder = pull_known(source, given)
    print(f"ready: {folder}")


def pull_known(name: str, given: str | None = None) -> Path:
    """Fetches a listed model and exports it into the cache. Returns the bundle's folder, at once where it is cached.
    given: a file or URL instead of the listed sources. Raises BundleError for an unknown name, MissingExtraError,
    DownloadError or ExportError.
    """
    from edgemap.runtime.network.manifest_file import read_manifest, verified_file
    from edgemap.runtime.network.store import cache_folder, shipped_folder

    if name not in KNOWN:
        raise BundleError(f"{name!r} is neither a bundle's folder nor URL, nor a known model ({', '.join(KNOWN)})")
    folder = cache_folder() / "bundles" / name
    if given is None and folder.is_dir():
        with suppress(BundleError):  # damaged or of an older format: made again
            manifest = read_manifest(folder)
            for file in manifest.sha256:
                verified_file(folder, manifest, file)
            return folder
    need("export", f"edgemap pull {name}")
    from edgemap.export.exporter import export_backbone
    from edgemap.export.obtain import obtain

    weights, sources = obtain(KNOWN[name], given)
    heads = sorted((shipped_folder() / "heads").glob(f"{name}.*.pt"))
    return export_backbone(name, folder, weights=weights, heads=heads, sources=sources)
