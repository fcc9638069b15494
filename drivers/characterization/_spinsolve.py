"""Messages of the Spinsolve software, and the files that it leaves in its folder.

Source:
    Magritek, Spinsolve remote control by XML, as public drivers and recorded exchanges have it;
    files as `docs/instruments_analysis.md` has them.
"""

from __future__ import annotations

import re
import struct
from html import unescape
from urllib.parse import quote

from drivers.base import DataFile
from drivers.transports.http import HttpTransport
from labweb.domain.errors import DeviceError, Effect, FrameError

END = b"</Message>"
HEAD = '<?xml version="1.0" encoding="UTF-8"?>'
FETCH_S = 60.0
MOST_FILE_BYTES = 32 * 2**20

PARAMETERS, FID, PROCESSED, JCAMP = "acqu.par", "data.1d", "spectrum_processed.1d", "spectrum.dx"
_NAMES = (
    *("Solvent", "Sample", "Custom", "CurrentTime", "b1Freq", "bandwidth", "dwellTime"),
    *("lowestFrequency", "nrPnts", "nrScans", "repTime", "pulseAngle", "rxChannel", "Protocol"),
)
"""What the parameters of every measurement tell."""

_HEADER = struct.Struct("<8i")
_BYTES_A_POINT = 12
"""An axis, a real and an imaginary part, each as float32."""


def encode_message(body: str) -> bytes:
    """Build a document.

    Example:
        >>> encode_message("<Abort/>")
        b'<?xml version="1.0" encoding="UTF-8"?><Message><Abort/></Message>'
    """
    return f"{HEAD}<Message>{body}</Message>".encode()


def decode_messages(received: bytes) -> str:
    """Read whole documents as text.

    Raises:
        FrameError: They are none.
    """
    try:
        text = received.decode("utf-8").strip()
    except UnicodeDecodeError as error:
        raise FrameError("answer is not text", context={"frame": received[:200].hex()}) from error
    if not re.fullmatch(
        r"(\s*(<\?xml [^<>]*\?>)?\s*<Message>((?!</?Message>).)*</Message>)+", text, re.DOTALL
    ):
        raise FrameError("answer is no document", context={"answer": text[:200]})
    return text


def decode_text(text: str, name: str) -> str:
    """Read the text of the one element of a name.

    Raises:
        FrameError: There is none, or several.

    Example:
        >>> decode_text("<Solvent>CDCl3</Solvent>", "Solvent")
        'CDCl3'
    """
    found = re.findall(rf"<{name}(?:\s*/>|>([^<>]*)</{name}>)", text)
    if len(found) != 1:
        raise FrameError(f"answer has {len(found)} elements {name}", context={"answer": text[:200]})
    return unescape(found[0])


def decode_attributes(text: str, name: str) -> list[dict[str, str]]:
    """Read the attributes of each element of a name.

    Example:
        >>> decode_attributes('<State status="Ready" dataFolder="/d"/>', "State")
        [{'status': 'Ready', 'dataFolder': '/d'}]
    """
    return [
        {key: unescape(value) for key, value in re.findall(r'(\w+)="([^"]*)"', inner)}
        for inner in re.findall(rf"<{name}((?:\s+\w+=\"[^\"<>]*\")*)\s*/?>", text)
    ]


def decode_number(text: str, what: str) -> float:
    """Read a number.

    Raises:
        FrameError: It is none.
    """
    if not re.fullmatch(r"-?[0-9]{1,9}(\.[0-9]{1,9})?", text.strip()):
        raise FrameError(f"{what} is {text[:80]!r}, no number")
    return float(text)


def whole_documents(received: bytes) -> int | None:
    """Tell the length of what has come once its last document is whole; None: it is not."""
    return len(received) if received.rstrip().endswith(END) else None


def whole_until_completed(received: bytes) -> int | None:
    """Tell the length of what has come once it says that all is over; None: it does not."""
    return whole_documents(received) if b"<Completed " in received else None


def fetch_files(
    share: HttpTransport, data_root: str, folder: str, sample: str
) -> tuple[DataFile, ...]:
    """Fetch the files of a measurement, and make sure that each is whole and of this sample.

    The JCAMP-DX file is one that not every software writes; the others always are there.

    Raises:
        DeviceError: A file is not there, or ends in the middle. What was measured lies in the
            folder all the same: PARTIAL, and nothing of the sample moved.
    """
    try:
        place = _below(data_root, folder)
        parameters = _fetch(share, place, PARAMETERS)
        points = _check_parameters(parameters, sample)
        fid = _fetch(share, place, FID)
        if (told := _points_of(FID, fid)) != points:
            raise FrameError(f"{FID} has {told} points, {PARAMETERS} tells {points}")
        processed = _fetch(share, place, PROCESSED)
        _points_of(PROCESSED, processed)
        found = [_kept(PARAMETERS, parameters), _kept(FID, fid), _kept(PROCESSED, processed)]
        spectrum = _fetch(share, place, JCAMP, is_needed=False)
        if spectrum:
            if not re.search(rb"##END=\s*$", spectrum):
                raise FrameError(f"{JCAMP} ends in the middle")
            found.append(DataFile(name=JCAMP, format="jcamp", data=spectrum))
    except DeviceError as error:
        error.effect = Effect.PARTIAL
        error.message += f"; the spectrum was taken and lies in {folder}"
        error.context |= {"data_folder": folder, "moved_ul": 0.0}
        raise
    return tuple(found)


def _below(data_root: str, folder: str) -> str:
    """Return the path of a folder below the root that is shared."""
    root, path = (text.replace("\\", "/").rstrip("/") for text in (data_root, folder))
    inner = path.removeprefix(f"{root}/")
    if inner == path or ".." in inner.split("/"):
        raise FrameError(f"the files lie in {folder!r}, which is not below {data_root!r}")
    return inner


def _fetch(share: HttpTransport, place: str, name: str, *, is_needed: bool = True) -> bytes:
    path = f"/{quote(place)}/{quote(name)}"
    reply = share.get(path, timeout_s=FETCH_S, longest_bytes=MOST_FILE_BYTES)
    if reply.status == 200 and reply.body:
        return reply.body
    if reply.status == 404 and not is_needed:
        return b""
    raise DeviceError(f"{name} cannot be fetched: status {reply.status}, {len(reply.body)} bytes")


def _check_parameters(content: bytes, sample: str) -> int:
    """Return the number of points, once the parameters are whole and of this sample."""
    try:
        text = content.decode("utf-8")
    except UnicodeDecodeError as error:
        raise FrameError(f"{PARAMETERS} is no text") from error
    told = dict(re.findall(r"^(\w+)\s*=\s*(.*?)\s*$", text, re.MULTILINE))
    missing = [name for name in _NAMES if name not in told]
    if missing or not text.endswith("\n"):
        raise FrameError(f"{PARAMETERS} ends in the middle; it does not tell {missing}")
    if told["Sample"].strip('"') != sample:
        raise FrameError(f"{PARAMETERS} is of sample {told['Sample']}, not of {sample!r}")
    if not re.fullmatch(r"[0-9]{1,9}", told["nrPnts"]):
        raise FrameError(f"{PARAMETERS} tells {told['nrPnts']!r} points")
    return int(told["nrPnts"])


def _points_of(name: str, content: bytes) -> int:
    """Return the number of points of a file that has as many as its header tells."""
    if len(content) < _HEADER.size:
        raise FrameError(f"{name} ends in its header")
    points: int = _HEADER.unpack_from(content)[4]
    length = _HEADER.size + _BYTES_A_POINT * points
    if points < 1 or len(content) != length:
        raise FrameError(f"{name} has {len(content)} bytes; {points} points take {length}")
    return points


def _kept(name: str, data: bytes) -> DataFile:
    kind = "text/plain" if name == PARAMETERS else "application/octet-stream"
    return DataFile(name=name, format="none", data=data, media_type=kind)
