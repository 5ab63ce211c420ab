"""HTML of the player; `player.page` replaces the fields between @ signs."""

PAGE = r"""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>@NAME@</title>
<link rel="icon" href="data:,">
<style>
:root { color-scheme: light; }
* { box-sizing: border-box; }
body { margin: 0 auto; padding: 12px 16px; max-width: 1500px; font: 15px/1.4 system-ui, sans-serif; color: #222;
       background: #fff; }
h1 { font-size: 1.15rem; margin: 0 0 8px; overflow-wrap: anywhere; }
canvas { display: block; width: 100%; }
#view { border: 1px solid #ccc; border-radius: 6px; }
#view { cursor: grab; touch-action: none; }
#view:active { cursor: grabbing; }
#page { display: grid; grid-template-columns: minmax(0, 1fr); gap: 4px 20px; }
@media (min-width: 900px) {
  #page.charts { grid-template-columns: minmax(0, 3fr) minmax(0, 2fr); grid-template-rows: auto 1fr; }
  #strips { grid-column: 2; grid-row: 1 / 3; } #more { grid-column: 1; grid-row: 2; }
}
figure { margin: 0 0 8px; }
figcaption { font-size: .82rem; display: flex; flex-wrap: wrap; gap: 0 12px; overflow-wrap: anywhere;
             font-variant-numeric: tabular-nums; }
figure canvas { touch-action: pan-y; cursor: ew-resize; }
.key { display: inline-block; width: 22px; height: 0; border-top: 3px solid; vertical-align: middle; margin-right: 4px; }
#bar, #more { display: flex; flex-wrap: wrap; gap: 4px 12px; align-items: center; margin: 8px 0 0; align-content: start; }
#more { margin: 0 0 8px; }
#slide { flex: 1 1 160px; min-width: 120px; }
button, select { font: inherit; padding: 6px 12px; min-height: 40px; touch-action: manipulation; border: 1px solid #777;
                 border-radius: 6px; background: #f4f4f4; color: #222; }
#play { min-width: 6em; font-weight: 600; }
:is(button, select, input, canvas):focus-visible { outline: 3px solid #0072B2; outline-offset: 1px; }
label { display: inline-flex; flex-wrap: wrap; gap: 6px; align-items: center; }
label[hidden] { display: none; }
output { font-variant-numeric: tabular-nums; min-width: 7em; }
select { max-width: 11em; }
input[type=checkbox] { width: 20px; height: 20px; margin: 8px 0; }
#slide { height: 40px; touch-action: none; }
#hint { color: #555; font-size: .87rem; margin: 6px 0; }
</style>
</head>
<body>
<h1>@NAME@</h1>
<div id="page">
<div>
<canvas id="view" tabindex="0" role="img" aria-label="Moving drawing of @NAME@"></canvas>
<div id="bar">
<button id="play" type="button" aria-label="Play">&#9654; Play</button>
<input id="slide" type="range" min="0" max="1000" value="0" step="1" aria-label="Time">
<output id="time" for="slide"></output>
<label>Speed <select id="speed">@SPEEDS@</select></label>
</div>
</div>
<div id="strips" hidden></div>
<div id="more">
<button id="back" type="button" aria-label="One picture back">&#8722;1</button>
<button id="on" type="button" aria-label="One picture on">+1</button>
<label><input id="loop" type="checkbox"> Repeat</label>
<label><input id="names" type="checkbox" checked> Names</label>
<label id="trailbox" hidden><input id="trails" type="checkbox" checked> Trails:</label>
<label id="followbox" hidden>Follow <select id="follow"><option value="">nothing</option></select></label>
<button id="reset" type="button">Reset view</button>
</div>
</div>
<p id="hint"></p>
<script id="film" type="application/json">@DATA@</script>
<script>
@SCRIPT@</script>
</body>
</html>
"""
