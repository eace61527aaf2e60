"""MCAP files read with suspicion, in the order in which they were written, as far as they go.

The MCAP library takes the sizes that a file gives for granted: here every size is checked before memory is taken, and a
file that was cut off, by a kill or a full disk, gives what it holds.
"""

import io
import os
import stat
import struct
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO, Any, NamedTuple

from vuca_nav.data_files import shown
from vuca_nav.errors import BadLog

MAGIC = b"\x89MCAP0\r\n"
MOST_RECORD = 64 * 2**20
"""Greatest size of a record, and of a chunk's content [bytes]: rosbag2 writes chunks of 0.8 MB."""
MOST_CHANNELS = 10_000


class LoggedMessage(NamedTuple):
    """A message of a log."""

    topic: str
    type_name: str
    """ROS name of its type."""
    number: int
    """Its number on the topic, as the writer counted."""
    log_time: int
    """[ns]"""
    data: bytes
    """CDR with its header."""


class LogFile:
    """The messages of an MCAP file.

    Args:
        path: The file.
        progress: Called with the number of bytes read.

    Raises:
        BadLog: If it is no MCAP file.

    Attributes:
        metadata: Metadata records by name, as far as the file has been read.
        size: Size of the file [bytes].
        damage: Why the file ends early; None if it does not, or has not been read to its end.
        skipped: Number of messages that are not of ROS 2.
    """

    def __init__(self, path: Path, progress: Callable[[int], None] = lambda _: None):
        self._path, self._progress = path, progress
        self.metadata: dict[str, dict[str, str]] = {}
        self.damage: str | None = None
        self.skipped = 0
        self._schemas: dict[int, Any] = {}
        self._channels: dict[int, Any] = {}
        with self._open() as file:
            self.size = os.fstat(file.fileno()).st_size
            if file.read(len(MAGIC)) != MAGIC:
                raise BadLog(
                    f"{path} is no MCAP file; a log of vuca deploy or of ros2 bag record -s mcap would be right"
                )

    def messages(self) -> Iterator[LoggedMessage]:
        """The messages in the order in which they were written, to the end or to the first damage."""
        import lz4.frame  # pyright: ignore[reportMissingImports]
        import zstandard  # pyright: ignore[reportMissingImports]
        from mcap.exceptions import McapError

        faults = (McapError, ValueError, struct.error, zstandard.ZstdError, RuntimeError, EOFError)
        with self._open() as file:
            file.seek(len(MAGIC))
            while True:
                at = file.tell()
                try:
                    found = self._record(file, (zstandard, lz4.frame))
                except faults as error:
                    self.damage = f"it is damaged from byte {at} on ({shown(error or type(error).__name__)})"
                    return
                if found is None:
                    return
                self._progress(file.tell())
                yield from found

    def _open(self) -> IO[bytes]:
        try:
            descriptor = os.open(self._path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
            if not stat.S_ISREG(os.fstat(descriptor).st_mode):
                os.close(descriptor)
                raise BadLog(f"{self._path} is no regular file; a log of vuca deploy would be right")
            return os.fdopen(descriptor, "rb")
        except OSError as error:
            raise BadLog(f"{self._path} cannot be read: {error.strerror}") from error

    def _record(self, file: IO[bytes], compressions: tuple[Any, Any]) -> list[LoggedMessage] | None:
        """The messages of the next record; None at the end of the data."""
        from mcap.data_stream import ReadDataStream
        from mcap.opcode import Opcode
        from mcap.records import Chunk

        head = file.read(9)
        if len(head) < 9:
            raise EOFError("it was cut off" if head else "it has no end: its writer was killed")
        kind, length = struct.unpack("<BQ", head)
        if kind in (Opcode.DATA_END, Opcode.FOOTER):
            return None
        if length > MOST_RECORD:
            raise ValueError(f"a record of {length} bytes, at most {MOST_RECORD} are read")
        body = file.read(length)
        if len(body) < length:
            raise EOFError("it was cut off")
        if kind != Opcode.CHUNK:
            message = self._take(kind, body)
            return [] if message is None else [message]
        chunk = Chunk.read(ReadDataStream(io.BytesIO(body)))
        content, messages = _unpacked(chunk, *compressions), []
        at = 0
        while at < len(content):
            kind, length = struct.unpack_from("<BQ", content, at)
            if length > len(content) - at - 9:
                raise ValueError("a record reaches beyond its chunk")
            message = self._take(kind, content[at + 9 : at + 9 + length])
            at += 9 + length
            if message is not None:
                messages.append(message)
        return messages

    def _take(self, kind: int, body: bytes) -> LoggedMessage | None:
        """Take in a record that is no chunk; returns the message if it is one of ROS 2."""
        from mcap.data_stream import ReadDataStream
        from mcap.opcode import Opcode
        from mcap.records import Channel, Message, Metadata, Schema

        stream = ReadDataStream(io.BytesIO(body))
        if kind == Opcode.SCHEMA:
            schema = Schema.read(stream)
            self._schemas[schema.id] = schema
        elif kind == Opcode.CHANNEL:
            channel = Channel.read(stream)
            self._channels[channel.id] = channel
        elif kind == Opcode.METADATA:
            metadata = Metadata.read(stream)
            self.metadata[metadata.name] = metadata.metadata
        elif kind == Opcode.MESSAGE:
            if len(body) < 22:
                raise ValueError("a message without its head")
            message = Message.read(stream, len(body)) if len(body) > 22 else None
            channel = None if message is None else self._channels.get(message.channel_id)
            schema = None if channel is None else self._schemas.get(channel.schema_id)
            if message is None or channel is None or schema is None or channel.message_encoding != "cdr":
                self.skipped += 1
                return None
            return LoggedMessage(channel.topic, schema.name, message.sequence, message.log_time, message.data)
        if max(len(self._schemas), len(self._channels), len(self.metadata)) > MOST_CHANNELS:
            raise ValueError(f"more than {MOST_CHANNELS} topics")
        return None


def _unpacked(chunk: Any, zstandard: Any, lz4: Any) -> bytes:
    """The content of a chunk; raises ValueError if it is larger than may be, or not what was written."""
    if chunk.uncompressed_size > MOST_RECORD:
        raise ValueError(f"a chunk of {chunk.uncompressed_size} bytes, at most {MOST_RECORD} are read")
    if chunk.compression == "zstd":
        with zstandard.ZstdDecompressor(max_window_size=MOST_RECORD).stream_reader(chunk.data) as stream:
            content = stream.read(chunk.uncompressed_size + 1)
    elif chunk.compression == "lz4":
        content = lz4.LZ4FrameDecompressor().decompress(chunk.data, max_length=chunk.uncompressed_size + 1)
    elif chunk.compression:
        raise ValueError(f"its chunks are compressed by {shown(chunk.compression)}, zstd or lz4 would be right")
    else:
        content = chunk.data
    if len(content) != chunk.uncompressed_size:
        raise ValueError("a chunk has another size than it says")
    if chunk.uncompressed_crc and zlib.crc32(content) != chunk.uncompressed_crc:
        raise ValueError("a chunk's checksum is wrong")
    return content
