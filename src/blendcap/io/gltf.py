"""The glTF 2.0 container: JSON, buffers and accessors, checked against the file before anything is allocated.

Khronos, glTF 2.0 specification, sections 3.6 (binary data storage) and 4 (GLB).
"""

from __future__ import annotations

import base64
import binascii
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

from blendcap.data import InputError
from blendcap.io.opening import parse_json, read_bytes

DTYPES: dict[int, np.dtype] = {
    5120: np.dtype("<i1"),
    5121: np.dtype("<u1"),
    5122: np.dtype("<i2"),
    5123: np.dtype("<u2"),
    5125: np.dtype("<u4"),
    5126: np.dtype("<f4"),
}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_REFUSED = {
    "KHR_draco_mesh_compression": "Draco-compressed",
    "EXT_meshopt_compression": "meshopt-compressed",
    "KHR_meshopt_compression": "meshopt-compressed",
    "KHR_mesh_quantization": "quantised",
}


@dataclass(frozen=True)
class Document:
    """One glTF file: its JSON, and its buffers when asked for.

    Parameters
    ----------
    path : Path
    json : dict
    chunk : bytes, optional
        The binary chunk of a GLB.
    """

    path: Path
    json: dict[str, Any]
    chunk: bytes | None

    def entry(self, kind: str, index: Any) -> dict[str, Any]:
        """The object `index` of the top-level list `kind`."""
        entries = self.json.get(kind, [])
        if not (isinstance(entries, list) and _whole(index) and index < len(entries)):
            raise InputError(f"The glTF names entry {index!r} of {kind}, which it does not have; export it again.")
        if not isinstance(entries[index], dict):
            raise InputError(f"The glTF's entry {index} of {kind} is no object; export it again.")
        return entries[index]

    def view(self, index: Any) -> tuple[memoryview, int]:
        """The bytes of a buffer view and its stride (0: tightly packed)."""
        view = self.entry("bufferViews", index)
        buffer = self._buffer(view.get("buffer"))
        start, length = _size(view, "byteOffset", 0), _size(view, "byteLength", None)
        if start + length > len(buffer):
            raise InputError(
                f"The glTF's buffer view {index} ends at byte {start + length}, but its buffer has {len(buffer)}; "
                "the file is cut short or damaged."
            )
        return memoryview(buffer)[start : start + length], _size(view, "byteStride", 0)

    def accessor(self, index: Any, count: int | None = None) -> np.ndarray:
        """The values (count, width) of an accessor, sparse or not; floats, or integers as they are.

        `count` is how many the reader expects. An accessor without a buffer view is all zeros and could ask for any
        size, so it is read only if the count is expected.
        """
        accessor = self.entry("accessors", index)
        dtype, width = DTYPES.get(accessor.get("componentType", 0)), WIDTHS.get(accessor.get("type", ""))
        if dtype is None or width is None:
            raise InputError(f"The glTF's accessor {index} has no known type; export it again.")
        declared = _size(accessor, "count", None)
        if count is not None and declared != count:
            raise InputError(f"The glTF's accessor {index} has {declared} elements where {count} are needed.")
        if "bufferView" in accessor:
            values = self._elements(accessor["bufferView"], _size(accessor, "byteOffset", 0), declared, dtype, width)
        elif count is not None:
            values = np.zeros((declared, width), dtype)
        else:
            raise InputError(f"The glTF's accessor {index} has no data; export it again.")
        if "sparse" in accessor:
            values = self._substituted(values, accessor["sparse"])
        return _floats(values) if accessor.get("normalized") else values

    def _elements(self, view: Any, offset: int, count: int, dtype: np.dtype, width: int) -> np.ndarray:
        content, stride = self.view(view)
        element = width * dtype.itemsize
        stride = stride or element
        needed = offset + (stride * (count - 1) + element if count else 0)
        if stride < element or needed > len(content):
            raise InputError(
                f"The glTF asks for {count} elements ({needed} bytes) from buffer view {view}, which has "
                f"{len(content)} bytes; the file is cut short or damaged."
            )
        strides = (stride, dtype.itemsize)
        return np.ndarray((count, width), dtype, buffer=content, offset=offset, strides=strides).copy()

    def _substituted(self, values: np.ndarray, sparse: dict[str, Any]) -> np.ndarray:
        count, where, what = _size(sparse, "count", None), sparse["indices"], sparse["values"]
        dtype = DTYPES[where["componentType"]]
        if count > len(values) or dtype.kind != "u":
            raise InputError(f"A sparse accessor of the glTF replaces {count} of {len(values)} elements; export again.")
        rows = self._elements(where["bufferView"], _size(where, "byteOffset", 0), count, dtype, 1)[:, 0]
        if count and int(rows.max()) >= len(values):
            raise InputError(f"A sparse accessor of the glTF replaces element {rows.max()} of {len(values)}.")
        width = values.shape[1]
        new = self._elements(what["bufferView"], _size(what, "byteOffset", 0), count, values.dtype, width)
        values[rows] = new
        return values

    def _buffer(self, index: Any) -> bytes:
        buffer = self.entry("buffers", index)
        uri, length = buffer.get("uri"), _size(buffer, "byteLength", None)
        if uri is None:
            if index != 0 or self.chunk is None:
                raise InputError(f"The glTF's buffer {index} has neither a URI nor a binary chunk; export it again.")
            content = self.chunk
        else:
            content = self.resource(uri)
        if length > len(content):
            raise InputError(
                f"The glTF declares a buffer of {length} bytes, but it has {len(content)}; the file is cut short."
            )
        return content

    def resource(self, uri: Any) -> bytes:
        """The bytes behind a URI: base64 data, or a file inside the folder of the glTF and nowhere else."""
        if not isinstance(uri, str):
            raise InputError(f"The glTF has the URI {uri!r}, which is no text; export it again.")
        if uri.startswith("data:"):
            head, _, body = uri.partition(",")
            if not head.endswith(";base64"):
                raise InputError("The glTF has a data URI that is not base64; export it as a GLB.")
            try:
                return base64.b64decode(body, validate=True)
            except (binascii.Error, ValueError):
                raise InputError("The glTF has a data URI that is not valid base64; export it as a GLB.") from None
        name, folder = unquote(uri), self.path.parent.resolve()
        outside = ":" in name or "\\" in name or "\0" in name or name.startswith("/")
        if outside or not (folder / name).resolve().is_relative_to(folder):
            shown = uri if len(uri) < 80 else uri[:77] + "..."
            raise InputError(
                f"The glTF points to {shown!r}, outside its own folder; put the file beside it or export a GLB."
            )
        return read_bytes(folder / name)


def open_document(path: Path) -> Document:
    """Open a .glb or .gltf file and refuse, by name, what cannot be read."""
    content = read_bytes(path)
    if content[:4] != b"glTF" and path.suffix.lower() == ".glb":
        raise InputError(f"Cannot read {path}: it is no GLB, whatever its name says; export it again.")
    text, chunk = _chunks(content) if content[:4] == b"glTF" else (content, None)
    json = parse_json(text, str(path))
    if not isinstance(json, dict):
        raise InputError("The glTF's JSON is no object; export it again.")
    version = (json.get("asset") or {}).get("version", "")
    if not str(version).startswith("2"):
        raise InputError(f"The file is glTF {version or 'of no stated version'}; export it as glTF 2.0.")
    for extension in json.get("extensionsRequired", []):
        if extension in _REFUSED:
            raise InputError(
                f"The meshes are {_REFUSED[extension]} ({extension}), which is not read; export without compression."
            )
    return Document(path, json, chunk)


def _chunks(content: bytes) -> tuple[bytes, bytes | None]:
    if len(content) < 20:
        raise InputError("The GLB is cut short: it ends inside its header.")
    version, length = struct.unpack_from("<II", content, 4)
    if version != 2:
        raise InputError(f"The GLB has version {version}; export it as glTF 2.0.")
    if length > len(content):
        raise InputError(f"The GLB is cut short: it declares {length} bytes and has {len(content)}.")
    text, chunk, place = None, None, 12
    while place + 8 <= length:
        size, kind = struct.unpack_from("<I4s", content, place)
        body = content[place + 8 : place + 8 + size]
        if len(body) < size:
            raise InputError(f"The GLB is cut short: a chunk declares {size} bytes and has {len(body)}.")
        if kind == b"JSON" and text is None:
            text = body
        elif kind == b"BIN\0" and chunk is None:
            chunk = body
        place += 8 + size
    if text is None:
        raise InputError("The GLB has no JSON chunk; export it again.")
    return text, chunk


def _whole(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value >= 0


def _size(entry: dict[str, Any], key: str, default: int | None) -> int:
    value = entry.get(key, default)
    if not _whole(value):
        raise InputError(f"The glTF has {key} {value!r} where a whole number is needed; export it again.")
    return value


def _floats(values: np.ndarray) -> np.ndarray:
    """Normalised integers as floats (glTF 2.0, section 3.11)."""
    if values.dtype.kind == "f":
        return values
    return np.maximum(values.astype(np.float32) / np.iinfo(values.dtype).max, -1.0)
