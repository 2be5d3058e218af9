from __future__ import annotations


class MobeeError(Exception):
    """A call that has no answer, in the words of the command line.

    Attributes
    ----------
    code : str
        One word for programs, such as ``shape``, ``limits``, ``file``.
    message : str
        What is wrong.
    place : str or None
        Where: an argument such as ``q[3]``, or ``file:line:column``.
    remedy : str
        What to do about it.
    """

    code: str
    message: str
    place: str | None
    remedy: str

    def __init__(self, code: str, message: str, place: str | None = None, remedy: str = "") -> None:
        super().__init__(code, message, place, remedy)
        self.code = code
        self.message = message
        self.place = place
        self.remedy = remedy

    def __str__(self) -> str:
        where = f"{self.place}: " if self.place else ""
        remedy = f"\n  help: {self.remedy}" if self.remedy else ""
        return f"{where}{self.message}{remedy}"
