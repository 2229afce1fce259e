"""Bodies of requests: a body that is too long or that does not end is refused."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator

from starlette.requests import Request

from aeromatch.workbench.allowed_actions import ActionError

# Greatest length of the body of a request without a file. [byte]
_MOST_BODY = 1_000_000
# Greatest time without a byte of a body that is not complete. [s]
_MOST_PAUSE = 10.0
# Greatest number of digits of a length that is compared with a limit.
_MOST_DIGITS = 18


class BodyError(ActionError):
    """A body that the server does not read to its end.

    Attributes
    ----------
    status : int
        Status of the response: 413 for a body that is too long, 408 for one that does not end.
    """

    def __init__(self, text: str, status: int = 413) -> None:
        super().__init__(text)
        self.status = status


def parse_length(stated: str | None) -> int:
    """Return a stated length, 0 without one.

    Parameters
    ----------
    stated : str or None
        Header ``Content-Length``. [byte]
    """
    # `int` refuses numbers of thousands of digits
    return int(stated[:_MOST_DIGITS]) if stated and stated.isdecimal() else 0


async def stream_body(request: Request) -> AsyncIterator[bytes]:
    """Yield the parts of a body.

    Raises
    ------
    BodyError
        No byte arrives for 10 s.
    ClientDisconnect
        The client left before the end of the body.
    """
    size, parts = 0, aiter(request.stream())
    while True:
        try:
            async with asyncio.timeout(_MOST_PAUSE):
                part = await anext(parts)
        except StopAsyncIteration:
            return
        except TimeoutError:
            text = f"the body stopped after {size} bytes, without a byte for {_MOST_PAUSE:g} s"
            raise BodyError(f"{text}; send the whole request again", 408) from None
        size += len(part)
        yield part


async def read_body(request: Request) -> bytes:
    """Return the body of a request without a file.

    Raises
    ------
    BodyError
        The header states more than 1 MB, more than 1 MB arrive, or no byte arrives for 10 s.
    ClientDisconnect
        The client left before the end of the body.
    """
    _demand_length(parse_length(request.headers.get("content-length")))
    body = b""
    async for part in stream_body(request):
        body += part
        _demand_length(len(body))
    return body


def _demand_length(size: int) -> None:
    if size > _MOST_BODY:
        raise BodyError(
            f"the body has {size} bytes or more; at most {_MOST_BODY} are read; divide the request"
        )
