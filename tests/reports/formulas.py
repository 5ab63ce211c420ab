"""A reader of LaTeX that evaluates printed formulas by SymPy alone, numbers and vectors of three."""

from __future__ import annotations

import re

import sympy as sp

E = sp.Symbol("e")  #: parameter of a motion
DIGITS, WORKING = 30, 120  #: of results and of the arithmetic
SPACES = {r"\,", r"\;", r"\!", r"\left", r"\right", r"\bigl", r"\bigr"}
ENDS = {"", "+", "-", ")", "}", ",", "]", "&", "=", ">", "<", r"\rVert", r"\rvert", r"\rfloor", r"\end", r"\\"}  #: of a product
FUNCTIONS = {r"\sin": sp.sin, r"\cos": sp.cos, r"\tan": sp.tan, r"\exp": sp.exp, r"\ln": sp.log, r"\tanh": sp.tanh,
             r"\arcsin": sp.asin, r"\arccos": sp.acos, r"\arctan": sp.atan}


class UnreadError(Exception):
    """A formula that is no sum of products of known symbols."""


def tokens(latex):
    """Commands, texts and characters, without spaces and sizes of brackets."""
    found = re.findall(r"\\text\{[^{}]*\}|\\operatorname\{[^{}]*\}|\\[A-Za-z]+|\\.|\d+(?:\.\d+)?|\S", latex)
    return [t for t in found if t not in SPACES]


class Reader:
    """The value of a formula. values: of names, tuples of tokens, or functions without arguments."""

    def __init__(self, latex, values):
        self.t, self.i, self.values = tokens(latex), 0, values

    def whole(self):
        found = self.sum()
        if self.i < len(self.t):
            raise UnreadError(self.t[self.i :])
        return found

    def peek(self):
        return self.t[self.i] if self.i < len(self.t) else ""

    def take(self, wanted=None):
        token = self.peek()
        if not token or (wanted and token != wanted):
            raise UnreadError(f"{token} for {wanted}")
        self.i += 1
        return token

    def sum(self):
        total = None
        while total is None or self.peek() in ("+", "-"):
            sign = -1 if self.peek() in ("+", "-") and self.take() == "-" else 1
            term = self.product() * sign
            total = term if total is None else term if total == 0 else total if term == 0 else total + term
        return total

    def product(self):
        found = self.power()
        while self.peek() not in ENDS:
            if self.peek() == "/":
                self.take()
                found = found / self.power()
                continue
            sign = self.take() if self.peek() in (r"\cdot", r"\times") else ""
            found = times(found, self.power(), sign)
        return found

    def power(self):
        found = self.atom()
        while self.peek() == "^":
            self.take()
            found = found ** self.group()
        return found

    def group(self):
        self.take("{")
        found = self.sum()
        self.take("}")
        return found

    def atom(self):
        names = [n for n in self.values if tuple(self.t[self.i : self.i + len(n)]) == n]
        if names:
            name = max(names, key=len)
            self.i += len(name)
            if self.peek() in ("_", "'"):
                raise UnreadError(f"{name} with {self.peek()}")
            found = self.values[name]
            return found() if callable(found) else found
        token = self.take()
        if re.fullmatch(r"\d+(\.\d+)?", token):
            return sp.Rational(token)
        if token == r"\pi":
            return sp.pi
        if token in (r"\frac", r"\tfrac"):
            above = self.group()
            return above / self.group()
        if token == r"\sqrt":
            return sp.sqrt(self.group())
        if token == r"\mathbf" and self.t[self.i : self.i + 3] == ["{", "0", "}"]:
            self.i += 3
            return sp.zeros(3, 1)
        if token in FUNCTIONS or token == r"\operatorname{atan2}":
            if self.peek() != "(":
                return FUNCTIONS[token](self.atom())
            self.take("(")
            arguments = [self.sum()]
            while self.peek() == ",":
                self.take()
                arguments.append(self.sum())
            self.take(")")
            return (FUNCTIONS.get(token) or sp.atan2)(*arguments)
        if token in ("(", "{"):
            found = self.sum()
            self.take(")" if token == "(" else "}")
            return found
        if token == r"\begin" and self.t[self.i : self.i + 7] == [*"{cases}"]:
            self.i += 7
            return self.chosen()
        if token == r"\text" or token == r"\operatorname{sgn}":
            return sp.sign(self.atom())
        if token == r"\lfloor":
            found = self.sum()
            self.take(r"\rfloor")
            return sp.floor(found)
        if token in (r"\lVert", r"\lvert"):
            found = self.sum()
            self.take(r"\rVert" if token == r"\lVert" else r"\rvert")
            return sp.sqrt(found.dot(found)) if token == r"\lVert" else sp.Abs(found)
        raise UnreadError(token)

    def chosen(self):
        """The first of several cases whose condition holds at the state."""
        found = None
        while True:
            case = self.sum()
            self.take("&")
            holds = self.peek().startswith(r"\text")
            if holds:
                self.take()
            else:
                left, relation = self.sum(), self.take()
                apart = sp.N(sp.sympify(left - self.sum()).subs(E, 0), DIGITS)
                holds = {">": apart > 0, "<": apart < 0}[relation]
            found = case if holds and found is None else found
            if self.take() == r"\end":
                self.i += 7
                return found


def times(a, b, sign):
    """A product of numbers and vectors."""
    m, n = (isinstance(x, sp.MatrixBase) for x in (a, b))
    if m and n:
        if sign == r"\times":
            return a.cross(b)
        if sign == r"\cdot":
            return a.dot(b)
        raise UnreadError("two vectors without a sign")
    if sign == r"\times":
        raise UnreadError("a vector product with a number")
    return a * b
