"""Papers in TeX and Markdown: what is read, what is said of what is not, and that planted errors are not cleared."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from runner import module_of

import mbdae as mb
from mbdae.audit.calculus import Letters
from mbdae.audit.notation import Node
from mbdae.audit.tex import Formula
from mbdae.audit.tex_items import Items, UnreadError
from mbdae.cli import main
from mbdae.documents.blocks import tokens
from mbdae.documents.displays import displays

PAPERS = Path(__file__).parents[2] / "validation" / "audit_tex"
LETTERS = {
    r"\theta_{1}": "q1", r"\theta_{2}": "q2", "m": "m", "L": "L", "x": "x", "a": "a", "b": "b", "v": "v", "n": "n", "g": "g",
    r"\bar{b}_{3}^{k}": "b3k", r"\bar{b}_{1}^{\ell}": "b1l", r"\mathbf{c}": "c", r"\mathbf{r}": "r", r"\mathbf{F}": "F",
    "r": "s", "r^{k}": "rk", "x'": "xp"}


def shape(node: Node) -> tuple[int, ...]:
    """Columns are r, F and what is one of them times a number."""
    columns = [n for n in node.walk() if n.kind == "symbol" and n.value in ("r", "F", "c")]
    return (3, 1) if columns else ()


def read(tex: str) -> str:
    """A display in the notation of audits."""
    letters = Letters({(key,): name for key, name in LETTERS.items()}, shape, lambda node: None, functions=frozenset({"g"}))
    cases = Formula(letters).cases(Items(tokens(tex)).all())
    said = ["; ".join(map(str, c.statements)) + "".join(f" if {a} {sign} {b}" for a, sign, b in c.conditions) for c in cases]
    return " | ".join(said)


@pytest.mark.parametrize(("tex", "text"), [
    (r"\frac12 m\dot x^2 = \tfrac{1}{2}\,m\,\dot{x}\,\dot x", "1/2*m*rate(x)^2 = 1/2*m*rate(x)*rate(x)"),
    (r"\bar b_3^{k\,T}\bar{b}^\ell_1 = \tilde{b}_3^{k} \mathbf c", "b3k'*b1l = ~b3k*c"),
    (r"\frac{d}{dt}\frac{\partial L}{\partial \dot\theta_1} - \frac{\partial L}{\partial\theta_1} = 0",
     "rate(diff(L, rate(q1))) - diff(L, q1) = 0"),
    (r"a = \frac{\mathrm{d}^2 x}{\mathrm{d}t^2}", "a = rate(rate(x))"),
    (r"\sin^2\theta_1 + \cos^{2}(\theta_1) = 1", "sin(q1)^2 + cos(q1)^2 = 1"),
    (r"\sin^{-1} a = \arcsin a", "asin(a) = asin(a)"),
    (r"\left|x\right| = \|\mathbf r\|", "abs(x) = norm(r)"),
    (r"a = \mathbf F\cdot\mathbf r, \quad \mathbf c = \mathbf r\times\mathbf F", "a = F'*r; c = ~r*F"),
    (r"\begin{split} x &= a \\ &\quad - b \end{split}", "x = a - b"),
    (r"\begin{aligned} x &= a, & v &= b \\ m &= 2 \end{aligned}", "x = a; v = b; m = 2"),
    (r"x = \begin{cases} a & \text{if } v > 0, \\ -a & \text{otherwise} \end{cases}", "x = a if v > 0 | x = -a if v <= 0"),
    (r"\begin{bmatrix} a & 0 \\ 0 & \cos\theta_1 \end{bmatrix} = \begin{pmatrix} 1 & 2 \\ 3 & 4 \end{pmatrix}^T",
     "[a, 0; 0, cos(q1)] = [1, 2; 3, 4]'"),
    (r"x = \int_0^a b\,x^{3/2}\,dx, \qquad a = \sum_{i=1}^{3} i\,b", "x = integral(b*x^(3/2), x, 0, a); a = sum(i*b, i, 1, 3)"),
    (r"e^{-|v/a|^n} \le g(v)", "exp(-abs(v/a)^n) <= g"),
    (r"\theta_i = a, \quad i = 1, 2", "q1 = a; q2 = a"),
    (r"r^k = r^2", "rk = s^2"),
    (r"\delta\mathbf r^T\mathbf F = \delta(x^2)", "delta(r)'*F = delta(x^2)"),
    (r"x' = \sqrt[3]{a}", "xp = a^(1/3)"),
    (r"x(t) = \dfrac{a}{b}\biggl(1 - \frac{b}{a}\biggr).", "x = a/b*(1 - b/a)"),
    (r"x = \int_0^a -b\,y + v\,dy - \int_0^1\int_0^a b\,dy\,dx", 
    "x = integral(-b*y + v, y, 0, a) - integral(integral(b, y, 0, a), x, 0, 1)"),
    (r"a = \mathbf r^2 + \frac12\dot{\mathbf r}^4", "a = r'*r + 1/2*(rate(r)'*rate(r))^2"),
    (r"\boxed{x {}={} a {-} b}", "x = a - b"),
    (r"x = a \quad \text{for} \quad 0 < v < 1", "x = a if 0 < v if v < 1"),
])
def test_what_is_read(tex: str, text: str) -> None:
    assert read(tex) == text


@pytest.mark.parametrize(("tex", "why"), [
    (r"x \approx a", "approximation"), (r"x = \pm a", "either sign"), ("x = y", r"the letter \$y\$ has no line"),
    (r"x = \frac{a}{", "formula ends|missing"), (r"x = \unknown{a}", "not known"), ("x", "no equation"),
    ("x = a +", "term is missing"), (r"x = \int b\,dx", "without limits"), (r"x = \max(a, b)", "print its cases"),
    (r"x_i = a, \quad i = 1, \ldots, n", "how far i counts"),
    (r"x = \left.\frac{a}{b}\right|_{v=0}", "value at a point"), ("a = -b = c >= 2", "has no line|one statement")])
def test_what_is_not_read_is_said(tex: str, why: str) -> None:
    with pytest.raises(UnreadError, match=why):
        read(tex)


def test_displays_with_numbers_labels_and_macros() -> None:
    text = r"""\newcommand{\vel}[2][x]{\dot{#1}_{#2}} \def\half#1{\frac{#1}{2}}
\begin{equation} a = \vel{1} % not $$ this
\label{eq:a}\end{equation}
\begin{align} a &= b \\ &= c \label{eq:b} \\ d &= \vel[y]{2}\nonumber \end{align}
\[ e = \half{f} \tag{A.1} \]
\begin{verbatim} $$ g = h $$ \end{verbatim}
\begin{subequations}\begin{align} a&=1,\\ b&=2 \end{align}\end{subequations}"""
    found = [(d.number, d.label, d.line, d.latex) for d in displays(text)]
    assert found == [("1", "eq:a", 2, r"a = \dot{x}_{1}"), ("3", "eq:b", 4, "a &= b &= c"), ("", "", 4, r"d &= \dot{y}_{2}"),
                     ("A.1", "", 5, r"e = \frac{f}{2}"), ("4a", "", 7, "a&=1,"), ("4b", "", 7, "b&=2")]
    markdown = "# One\n\n$$ a = b \\tag{2} $$\n\n```math\nc = d\n```\n\n```python\nx = '$$ e $$'\n```\n$$ f $$ {#eq:f}\n"
    assert [(d.number, d.label, d.line, d.latex, d.section) for d in displays(markdown, markdown=True)] == [
        ("2", "", 3, "a = b", "One"), ("", "", 6, "c = d", "One"), ("", "eq:f", 12, "f", "One")]


@pytest.mark.parametrize(("tex", "shown"), [  # of each display its number, TeX, label
    (r"\begin{IEEEeqnarray}{rCl} g & = & h \IEEEnonumber \\ & = & a \\ i &=& j \label{i} \end{IEEEeqnarray}",
     [("1", "g & = & h & = & a", ""), ("2", "i &=& j", "i")]),
    (r"\begin{empheq}[left=\empheqlbrace]{align*} a &= b \\ c &= d \end{empheq}", [("", "a &= b", ""), ("", "c &= d", "")]),
    (r"\begin{numcases}{|x| =} x, & for $x > 0$ \\ -x, & for $x < 0$ \end{numcases}",
     [("1", r"|x| = \begin{cases} x, &\text{for} x > 0 \\ -x, &\text{for} x < 0 \end{cases}", "")]),
    (r"\equation a = b \endequation", [("1", "a = b", "")]),
    (r"\def\be{\begin{equation}}\def\ee{\end{equation}} \be a = b \ee", [("1", "a = b", "")]),
    (r"\let\be\equation\let\ee\endequation \be a = b \ee", [("1", "a = b", "")]),
    (r"\newcommand{\eqn}[2][x]{\begin{equation}\label{#1} #2 \end{equation}} \eqn[y]{a = b} \eqn{c = d}",
     [("1", "a = b", "y"), ("2", "c = d", "x")]),
    (r"\newenvironment{law}[1]{\begin{equation}\label{#1}}{\end{equation}} \begin{law}{l} a = b \end{law}",
     [("1", "a = b", "l")]),
    (r"\begin{alignat}{2} a &= b &\quad c &= d \end{alignat}", [("1", r"a &= b \quad \quad c &= d", "")]),
    (r"\begin{flalign} && a = b && \\ & -c = d & \end{flalign}",
     [("1", r"&\quad  a = b &\quad", ""), ("2", r"& -c = d \quad", "")]),
    (r"\begin{dmath}[label={q}] a = b \end{dmath}", [("1", "a = b", "q")]),
    (r"\begin{equation} a = b \end{equation} \begin{equation} & = c \end{equation}", [("1", "a = b", ""), ("2", "& = c", "")]),
    (r"$$ a = b \eqno (7) $$ and $c$$d$", [("7", "a = b", "")]),
    (r"\setcounter{equation}{6} \begin{equation} a = b \end{equation}", [("7", "a = b", "")]),
    (r"\numberwithin{equation}{section} \section*{0} \section{1} \appendix \section{2} \begin{align} a = b \end{align}",
     [("A.1", "a = b", "")]),
])
def test_displays_of_every_kind(tex: str, shown: list[tuple[str, str, str]]) -> None:
    assert [(d.number, d.latex, d.label) for d in displays(tex) if not d.trouble] == shown
    assert not [d for d in displays(tex) if d.trouble]


@pytest.mark.parametrize(("tex", "why"), [
    (r"Words \begin{boxed} F = m a \end{boxed} words.", "the environment `boxed` is not known"),
    (r"Words \beq F = m a \quad\text{for $a$} \eeq words.", r"macros `\\beq` and `\\eeq` are defined nowhere"),
    (r"\formula m \ddot x = F \end", "outside of all displays"),
    (r"\begin{equation} F = m a", r"not closed by `\\end{equation}`"), ("$$ F = m a\n\nWords $$", r"not closed by `\$\$`"),
    ("\\[ F = m a\n\n\\[ c = d \\]", r"not closed by `\\\]` before line"),
    (r"\begin{equation} F = m a \end{align}", r"closed by `\\end{align}`"), (r"Words \end{equation}", "closes no display"),
    (r"\begin{empheq}[left={F=}]{align} m a \end{empheq}", "is not read"), (r"\input{forces}", "`forces` displays is not read"),
    (r"\setcounter{equation}{\value{page}}", "sets the numbers of equations"),
    (r"\begin{dgroup} \end{dgroup}", "counts is not known")])
def test_no_display_is_left_out(tex: str, why: str) -> None:
    """What is not read is said in its place, and later equations have no number that may be wrong."""
    first, last = r"\begin{equation} a = b \end{equation}", r"\begin{align} c = d \label{c} \end{align}"
    found = displays(f"First.\n{first}\n\n{tex}\n\n{last}\n")
    assert (found[0].number, found[0].line) == ("1", 2)
    assert (found[-1].number, found[-1].label, found[-1].latex) == ("", "c", "c = d")
    told = [d for d in found if d.trouble]
    assert re.search(why, told[0].trouble), told
    assert told[0].line == 4


def test_displays_of_markdown() -> None:
    text = "> $$\n> a = b\n> $$\n\n```{math}\n:label: c\nc = d\n```\n\nFor $5 x = 3, a_b = c_d.\n\n$$ e = f\n\n$$ g = h $$\n"
    found = [(d.latex, d.label, bool(d.trouble)) for d in displays(text, markdown=True)]
    assert found == [("a = b", "", False), ("c = d", "c", False), ("$$ e = f", "", True), ("g = h", "", False)]


SPRING = r"""The deflection is $x$; $m$ is the mass of the body and $k$ is the stiffness of the spring.
\begin{equation}\label{eq:V} V = \frac{1}{2} k x^2 \end{equation}
\begin{equation}\label{eq:m} m\ddot x + k x = 0 \end{equation}
\begin{equation}\label{eq:w} \omega = \sqrt{\frac{k}{m}} \end{equation}
\begin{equation}\label{eq:T} \tau = \frac{2\pi}{\omega} \end{equation}
\begin{equation}\label{eq:E} P = k x \end{equation}
"""
TABLE = r"""x [m]: function of time
m [kg]: positive number
k [N/m]: positive number
let V [J] = integral(k*y, y, 0, x)
y [m]: number
omega [rad/s]: defined by eq:w
let tau [s] $\tau$ = 2*pi*sqrt(m/k)
P [W]: number
"""


def test_a_table_is_begun_and_confirmed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Guesses are marked and nothing that contains one is judged; a confirmed table, with what an equation of motion stands
    for, judges all."""
    paper = tmp_path / "spring.tex"
    paper.write_text(SPRING, encoding="utf-8")
    assert main(["audit", str(paper)]) == 1
    assert "spring.meanings: confirm its letters" in capsys.readouterr().out
    table = paper.with_suffix(".meanings")
    lines = table.read_text(encoding="utf-8").splitlines()
    assert "? m [kg] $m$: positive number   # the mass of the body and" in lines
    assert "? x [m] $x$: function of time" in lines
    first = mb.audit(paper)
    assert not first.begun
    assert {row.verdict for row in first.equations} == {"CANNOT JUDGE"}
    assert "does not yet confirm" in first["eq:V"].remark
    assert "its units agree" in first["eq:V"].remark
    table.write_text("y [m]: number\n" + TABLE, encoding="utf-8")
    found = mb.audit(paper)
    assert found["eq:V"].verdict == "RIGHT"
    assert found["eq:m"].verdict == "CANNOT JUDGE"  # an equation of motion that nothing defines is not blamed
    assert "equation 2 [unit]: formula" in found["eq:m"].remark
    assert found["eq:w"].verdict == "CANNOT JUDGE"  # the definition of the text
    assert found["eq:T"].verdict == "RIGHT"
    assert found["eq:E"].verdict == "MISPRINT"  # dimensions first: P is a power
    assert "unit" in found["eq:E"].remark
    table.write_text("y [m]: number\n" + TABLE + "equation eq:m [N]: m*rate(rate(x)) + diff(V, x)\n", encoding="utf-8")
    assert mb.audit(paper)["eq:m"].verdict == "RIGHT"
    paper.write_text(SPRING.replace(r"\ddot x + k x", r"\ddot x - k x").replace(r"\tau = ", r"\rho = "), encoding="utf-8")
    wrong = mb.audit(paper)
    assert wrong["eq:m"].verdict == "MISPRINT"
    assert wrong["eq:T"].remark.startswith("spring.tex:5: the letter $\\rho$")
    page = wrong.save(tmp_path / "spring.html").read_text(encoding="utf-8")
    assert "spring.tex:3" in page
    assert r"m \, \ddot{x} + k \, x" in page  # the repair in the letters of the paper


def test_planted_errors_of_a_paper_are_not_cleared() -> None:
    """Six errors, one of each kind, drawn from the campaign of validation/audit_tex; the pendulum as it is printed is right."""
    check = module_of(PAPERS.parent, "audit_tex")
    rows = [(kind, right, check.audit_equation(wrong, search=False))
            for kind, right, wrong in check.plants("pendulum.tex", 6, seed=5)]
    assert {kind for kind, *_ in rows} == {"sign", "factor", "missing term", "sin for cos", "index", "power"}
    assert [row.equation for _, _, row in rows if row.verdict != "MISPRINT"] == []
    assert all(row.verdict == "RIGHT" for row in check.audited("pendulum.tex").equations)


def test_what_a_letter_is_at_a_place_is_not_guessed():
    """M at the end and words before a formula were judged, some right ones as misprints."""
    table = ("x [m]: positive number\nl [m] $L$: positive number\nP [N]: positive number\n"
             "let M [N m] $M(x)$ = P*(l - x)\n")
    right = (r"M(x) = P(L - x)", r"\frac{dM}{dx} = -P", r"M' = -P", r"M'(x) = -P")
    unread = (r"M(L) = 0", r"M(0) = PL", r"\text{not }P = M")
    paper = "\n".join(rf"\begin{{equation}}{tex}\end{{equation}}" for tex in (*right, *unread)) + "\n"
    found = mb.audit(paper, meanings=table)
    assert [found[str(n)].verdict for n in range(1, 8)] == ["RIGHT"] * 4 + ["CANNOT JUDGE"] * 3


def verdicts(paper: str, table: str) -> list[str]:
    return [row.verdict for row in mb.audit(paper, meanings=table).equations]


def test_an_identity_has_the_size_of_what_stands_beside_it() -> None:
    table = "\nphi [rad]: function of time\nlet R [1] = [cos(phi), -sin(phi); sin(phi), cos(phi)]\n"
    right = (r"R^T R = I", r"R R^{\top} - \mathbf{1}_2 = 0", r"R^{-1} R = I_{2\times 2}")
    assert verdicts("\n".join(rf"\[{tex}\]" for tex in right), table) == ["RIGHT"] * 3
    assert verdicts("\n" + r"\[R^T R = 2 I\]", table) == ["MISPRINT"]
    assert verdicts("\n" + r"\[I \ddot\phi = -\phi\]", table) == ["CANNOT JUDGE"]  # a letter without a line is not taken for one


@pytest.mark.parametrize("line", ["q [m] $z($: number", r"q [m] $\left.z\right|$: number", "q [m] $k$: number",
                                  "F [N]: number", "x [m]: function of time in (0, 1", "equation 9: force",
                                  "q [m]: defined by 77",
                                  "let q [m] = " + "(" * 500 + "x" + ")" * 500])
def test_a_bad_line_spoils_itself_alone(line: str) -> None:
    table = f"\nx [m]: number\nk [N/m]: positive number\nlet F [N] = k*x\n{line}\n"
    paper = "\n" + r"\[F = k x\] \[F = 2kx\]"
    found = mb.audit(paper, meanings=table).equations
    assert [row.verdict for row in found] == ["CANNOT JUDGE", "RIGHT", "MISPRINT"]
    assert found[0].remark.startswith("meanings:5: ")


@pytest.mark.parametrize("tex", [r"\frac{1}{" * 500 + "x" + "}" * 500, "(" * 500 + "x" + ")" * 500, r"\sin" * 500 + " x",
                                 "k" + "^{k" * 500 + "}" * 500, r"\dot{" * 500 + "x" + "}" * 500])
def test_what_nests_too_deep_is_said(tex: str) -> None:
    found = mb.audit("\n" + rf"\[F = {tex}\] \[F = k x\]", meanings="\nx [m]: number\nk [N/m]: number\nlet F [N] = k*x\n")
    assert [row.verdict for row in found.equations] == ["CANNOT JUDGE", "RIGHT"]
    assert "deep" in found.equations[0].remark
    assert found.document().to_html()


def test_what_is_not_typeset_is_not_read() -> None:
    text = r"""\newcommand{\beq}{\begin{equation}} \newcommand{\eeq}{\end{equation}} \newcommand{\kept}{\[ h \]} \[ p \]
\begin{document} \iffalse \[ a \] \ifdraft \[ b \] \else \[ c \] \fi \[ d \] \fi \[ e \]
\iffalse \[ f \] \else \[ g \] \fi \verb|\[ i \]| a \iff b
\begin{minted}{tex} $$ j $$ \end{minted} \beq k \eeq
\end{document} \[ l \]
"""
    assert [(d.latex, d.line) for d in displays(text)] == [("e", 2), ("g", 3), ("k", 4)]
    markdown = "`$$ a $$` $`x`$\n\n    $$ b $$\n\n1. one\n\n    $$ c $$\n\ntext\n\n~~~\n$$ d $$\n~~~\n$$ e $$\n"
    assert [(d.latex, d.line) for d in displays(markdown, markdown=True)] == [("c", 7), ("e", 14)]


def test_the_rate_of_the_time_is_one_and_greek_letters_have_two_forms() -> None:
    table = "\nt [s]: number\nA [m]: number\nomega [rad/s]: number\nphi [rad]: number\nlet x [m] = A*cos(omega*t + phi)\n"
    right = "\n" + r"\[x = A\cos(\omega t + \varphi)\] \[\dot x = -A\omega\sin(\omega t + \phi)\]"
    assert verdicts(right, table) == ["RIGHT"] * 2
    assert verdicts("\n" + r"\[\dot x = A\omega\sin(\omega t + \phi)\]", table) == ["MISPRINT"]


def test_a_letter_with_the_argument_it_depends_on_is_no_product() -> None:
    table = "\nphi [rad]: function of time\nr [m]: number\nl [m]: number\nlet x [m] = r*cos(phi)\nlet M [m] = r - l\n"
    paper = "\n" + r"\[x(\varphi) = r\cos\varphi\] \[M(l) = 0\] \[x(r) = r\] \[r(l) = l r\]"
    assert verdicts(paper, table) == ["RIGHT", "CANNOT JUDGE", "CANNOT JUDGE", "RIGHT"]


RATES = r"""x [m]: function of time
m [kg]: positive number
k [N/m]: positive number
c [N s/m]: positive number
let V [J] = 1/2*k*x^2
let T [J] = 1/2*m*rate(x)^2
let E [J] = T + V
let p [kg m/s] = m*rate(x)
let L [J] = T - V
"""


@pytest.mark.parametrize(("tex", "verdict"), [
    (r"\dot V = k x\dot x", "RIGHT"), (r"\dot V = 2 k x\dot x", "MISPRINT"), (r"\ddot V = k\dot x^2 - k x\ddot x", "MISPRINT"),
    (r"\dot T = 3 m\dot x\ddot x", "MISPRINT"), (r"\frac{dT}{dt} = m\dot x^2", "MISPRINT"),  # by its units
    (r"\dot E = \dot x(m\ddot x - k x)", "MISPRINT"), (r"\dot p = 2m\ddot x", "MISPRINT"),
    (r"\dot p = -k x", "CANNOT JUDGE"), (r"\dot E = 0", "CANNOT JUDGE"), (r"\dot T = -k x\dot x", "CANNOT JUDGE"),
    (r"\dot E = -c\dot x^2", "CANNOT JUDGE"), (r"\dot T = -\dot V", "CANNOT JUDGE"), (r"m\ddot x = -k x", "CANNOT JUDGE"),
    (r"\dot T + \dot V = 0", "CANNOT JUDGE"), (r"\dot T + \dot V = \dot x(m\ddot x + 2k x)", "MISPRINT"),
    (r"\frac{d}{dt}\frac{\partial L}{\partial\dot x} = \frac{\partial L}{\partial x}", "CANNOT JUDGE")])
def test_rates_worked_out_and_laws_of_motion(tex: str, verdict: str) -> None:
    """The rate of a quantity that the table defines is judged; how it changes in a motion is not, whatever moves it."""
    row = mb.audit(f"\n\\[ {tex} \\]\n", meanings=RATES).equations[0]
    assert row.verdict == verdict, row.said


def test_powers_of_vectors() -> None:
    """The square of a vector is that of its length; what is repaired has the units of what it equals."""
    table = ("J [kg m^2]: positive number\nm [kg]: positive number\nomega [rad/s]: angular velocity of k\n"
             "v [m/s]: velocity of k\nlet T [J] = 1/2*J*omega'*omega + 1/2*m*v'*v\n")
    text = "\n\\[ T = %s \\]\n"
    assert mb.audit(text % r"\tfrac12 J\omega^2 + \tfrac12 m v^2", meanings=table).equations[0].verdict == "RIGHT"
    row = mb.audit(text % r"\tfrac12 J^2\omega^2 + \tfrac12 m v^2", meanings=table).equations[0]
    assert (row.verdict, row.repair) == ("MISPRINT", "J^2 -> J")


@pytest.mark.parametrize(("tex", "verdict", "words"), [
    (r"F = \num{1.0e0} m g", "RIGHT", ""), (r"F = \num{2 000} m g/\num{2e3}", "RIGHT", ""),
    (r"F = \num{1,5} m g", "MISPRINT", ""),
    (r"F\sin\ang{30} = \num{.5}m g", "RIGHT", ""), (r"F\sin\qty{90}{\degree} = m g", "RIGHT", ""),
    (r"F\sin\SI{90}{\radian} = m g", "MISPRINT", ""), (r"F = \SI{3}{kg} g", "CANNOT JUDGE", "the value 3 with the unit `kg`"),
    (r"g = \qty{9.81}{\metre\per\second\squared}", "CANNOT JUDGE", "9.81"), (r"F = \num{1e999} m g", "CANNOT JUDGE", "1e999"),
    (r"F = \num{3 \pm 1} m g", "CANNOT JUDGE", "is not read")])
def test_numbers_of_siunitx(tex: str, verdict: str, words: str) -> None:
    """Numbers and angles are read, with one argument or two; a value with another unit is not judged and named whole."""
    table = "m [kg]: positive number\ng [m/s^2]: positive number\nlet F [N] = m*g\n"
    row = mb.audit(f"\n\\[ {tex} \\]\n", meanings=table).equations[0]
    assert row.verdict == verdict, row.said
    assert words in str(row.said) + str(row)


# -- derivatives


MASS = "x [m]: function of time\nm [kg]: positive number\nlet E [J] = 1/2*m*rate(x)^2\n"
BEAM = ("x [m]: number\nL [m]: positive number\nq [N/m] $q_0$: number\nE [Pa]: positive number\nI [m^4] $I$: positive number\n"
        "let w [m] = q*x^2*(6*L^2 - 4*L*x + x^2)/(24*E*I)\n")


def verdict(tex: str, table: str) -> str:
    """The verdict on one display."""
    return mb.audit(f"\n\\begin{{equation}}{tex}\\end{{equation}}\n", meanings=table)["1"].verdict


@pytest.mark.parametrize("time", ["", "t [s]: number\n", "tau [s] $t$: time\n"])
@pytest.mark.parametrize(("tex", "said"), [
    (r"\frac{dE}{dt} = m\dot x\ddot x", "RIGHT"), (r"\frac{\mathrm{d}E}{\mathrm{d}t} = m\dot x\ddot x", "RIGHT"),
    (r"\frac{d^2x}{dt^2} = \ddot x", "RIGHT"), (r"\frac{\partial x}{\partial t} = \dot x", "RIGHT"),
    (r"\frac{d}{dt}\left(m x^2\right) = 2 m x\dot x", "RIGHT"), (r"\frac{dE}{dt} = 2m\dot x\ddot x", "MISPRINT")])
def test_a_derivative_by_the_time_is_the_whole_one(tex: str, said: str, time: str) -> None:
    """Whether or not the table has a line for the time."""
    assert verdict(tex, MASS + time) == said


def test_a_partial_derivative_by_the_time_is_that_of_what_contains_it() -> None:
    table = MASS + "t [s]: number\nlet V [kg m s] = m*x*t\n"
    assert verdict(r"\frac{\partial V}{\partial t} = m x", table) == "RIGHT"
    assert verdict(r"\frac{dV}{dt} = m x + m t\dot x", table) == "RIGHT"
    assert verdict(r"\frac{dV}{dt} = m x", table) == "CANNOT JUDGE"
    assert verdict(r"\frac{\partial E}{\partial t} = 0", table) == "CANNOT JUDGE"


@pytest.mark.parametrize(("tex", "said"), [
    ("E I w^{(4)} = q_0", "RIGHT"), ("E I w^{(iv)} = q_0", "RIGHT"), (r"E I w^{\mathrm{IV}} = q_0", "RIGHT"),
    (r"E I w^{\prime\prime\prime\prime} = q_0", "RIGHT"), (r"\left(E I w''\right)'' = q_0", "RIGHT"),
    ("E I w'''' = q_0", "RIGHT"), ("E I w''(x) = q_0 (L - x)^2/2", "RIGHT"), ("E I w^{(3)} = q_0 (x - L)", "RIGHT"),
    ("E I w^{IV}(x) = q_0", "RIGHT"), ("w^4 = w\\,w^3", "RIGHT"),
    ("E I w^{(4)} = 2q_0", "MISPRINT"), ("E I w^{(3)} = q_0", "MISPRINT"), ("E I w''' = q_0 (L - x)", "MISPRINT"),
    (r"\left(E I w''\right)'' = 2 q_0", "MISPRINT"), ("E I w^{(n)} = 0", "CANNOT JUDGE"), ("w^{(2)} = w", "CANNOT JUDGE")])
def test_primes_and_orders_in_brackets_are_derivatives(tex: str, said: str) -> None:
    """By the letter that the definition contains."""
    assert verdict(tex, BEAM) == said


SWING = ("g [m/s^2]: positive number\nl [m]: positive number\nh [m]: positive number\nlet omega0 [rad/s] = sqrt(g/l)\n"
         "f [1/s]: number\nlet T1 [s] = 1/f\n")


@pytest.mark.parametrize("more", ["", "let T0 [s] = 2*pi*sqrt(l/g)\nv [m/s]: number\nn [1/s]: number\n"])
@pytest.mark.parametrize(("tex", "said"), [
    (r"\omega_0 = \sqrt{\frac{g}{l}} = 2\pi f", "CANNOT JUDGE"), (r"\omega_0 = 2\pi f", "CANNOT JUDGE"),
    (r"2\pi f = \omega_0", "CANNOT JUDGE"), (r"\omega_0 = \frac{2\pi}{T_1} = 2\pi f", "CANNOT JUDGE"),
    (r"\omega_0 = \sqrt{\frac{2g}{l}} = 2\pi f", "MISPRINT"), (r"\omega_0 = \frac{\pi}{T_1} = 2\pi f", "MISPRINT"),
    (r"\omega_0 = 2\pi f l", "MISPRINT"), (r"\omega_0 = \sqrt{\frac{g}{l}} + f", "MISPRINT")])
def test_an_equation_that_may_define_a_letter_is_not_blamed(tex: str, said: str, more: str) -> None:
    """However many letters the table has; what is wrong whatever the letter is stays blamed."""
    assert verdict(tex, SWING + more) == said


OLDER = ("E1 [Pa] $E^*$: positive number\nk [N/m] $k_{\\rm s}$: positive number\nx [m]: function of time\nt [s]: number\n"
          "mu [1]: positive number\nN [N]: positive number\nlet v [m/s] = rate(x)\nlet R [N] = -mu*N*sign(v)\nlet F [N] = k*x\n"
          "let V [J] = 1/2*k*x^2\nlet W [Pa^2] $W_{\\rm r}$ = E1^2\nr [m] $\\bf r$: vector function of time\n"
          "let c [m/s] $\\mathbf c$ = rate(r)\n")


@pytest.mark.parametrize(("tex", "said"), [
    (r"F = k_{\rm s} x", "RIGHT"), (r"F = k_s x", "RIGHT"),
    (r"W_{\rm r} = {E^*}^2", "RIGHT"), (r"W_{\mathrm{r}} = E^{*2}", "RIGHT"),
    (r"\frac{{\rm d}{\bf r}}{{\rm d}t} = {\bf c}", "RIGHT"), (r"\left(\bf r\right)^2 = \mathbf r^2", "RIGHT"),
    (r"F = \dv{V}{x}", "RIGHT"), (r"F = \pdv{V}{x}", "RIGHT"), (r"F = \od{V}{x}", "RIGHT"), (r"\dv[2]{x}{t} = \ddot x", "RIGHT"),
    (r"\dv{t} V = k_s x\dot x", "RIGHT"), (r"k_s = \pdv{V}{x}{x}", "RIGHT"), (r"k_s = \pdv[2]{V}{x}", "RIGHT"),
    (r"F = 2\dv{V}{x}", "MISPRINT"), (r"W_{\rm r} = {E^*}^3", "MISPRINT"), (r"\dv{V}{t} = 2k_s x\dot x", "MISPRINT"),
    (r"F = -k_{\rm s} x", "MISPRINT"), (r"\frac{{\rm d}{\bf r}}{{\rm d}t} = -{\bf c}", "MISPRINT")])
def test_fonts_up_to_the_end_of_a_group_stars_and_macros_of_derivatives(tex: str, said: str) -> None:
    assert verdict(tex, OLDER) == said


def test_full_stops_end_rows_of_cases() -> None:
    for first, last in ((",", "."), (";", ","), ("", ".")):
        rows = rf"R = \begin{{cases}} -\mu N, & v > 0{first} \\ \mu N, & v < 0{last} \end{{cases}}"
        found = mb.audit(f"\n\\begin{{equation}}{rows}\\end{{equation}}\n", meanings=OLDER)
        assert [found[n].verdict for n in ("1.1", "1.2")] == ["RIGHT", "RIGHT"]


@pytest.mark.parametrize(("tex", "where"), [
    (r"R = -\mu N\frac{v}{|v|}", "v != 0"), (r"R = -\mu N\frac{\dot x}{|\dot x|}", "rate(x) != 0"),
    (r"R = -\mu N\frac{v |v|}{v^2}", "v != 0"), (r"F = \frac{k_s x^2}{x}", "x != 0")])
def test_a_divisor_that_vanishes_is_named_itself(tex: str, where: str) -> None:
    """The rate of a position may be zero elsewhere than the position."""
    row = mb.audit(f"\n\\begin{{equation}}{tex}\\end{{equation}}\n", meanings=OLDER)["1"]
    assert (row.verdict, row.where) == ("RIGHT", where)


@pytest.mark.parametrize(("formula", "table"), [
    ("w(0) = 0", "a [m]: positive number\ny [m]: number\nlet w [m] = a+y\n"),
    ("w(0) = a", "a [m]: positive number\ny [m]: number\nlet w [m] = a+y\n"),
    (r"w(L/2) = b", "L [m]: positive number\nb [m]: number\nx [m]: number\nlet w [m] = x*(L-x)/L\n"),
    (r"w(\frac L2) = b", "L [m]: positive number\nb [m]: number\nx [m]: number\nlet w [m] = x*(L-x)/L\n"),
    (r"x(0) = 0", "x [m]: number\n"), (r"\dot x(0) = 0", "x [m]: function of time\n")])
def test_a_value_at_a_place_is_no_product(formula: str, table: str) -> None:
    assert "CANNOT JUDGE" in mb.audit(f"\n\\begin{{equation}}{formula}\\end{{equation}}\n", meanings=table).table()
