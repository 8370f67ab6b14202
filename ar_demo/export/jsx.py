"""After Effects' script (.jsx, ExtendScript): sets a Corner Pin on the layer that is selected.

It moves the layer's origin to the composition's, so that the values count from there whatever the layer's size. Keys
are set by time, so that a variable frame rate is no matter. ExtendScript is ECMAScript 3.
"""

import json

from .after_effects import CORNER_PIN
from .coordinates import from_top_left
from .keys import Keys, number

SCRIPT = """(function () {
    var width = %(width)d, height = %(height)d;  // px, of the video
    var times = [%(times)s];  // s
    var holds = [%(holds)s];  // keys, counted from 1, that end a shot
    var corners = {
%(corners)s
    };

    function still(property, value) {
        property.expression = "";
        while (property.numKeys > 0) { property.removeKey(property.numKeys); }
        property.setValue(value);
    }

    var comp = app.project.activeItem;
    if (!(comp instanceof CompItem) || comp.selectedLayers.length !== 1) {
        alert("Select the layer that is to be pinned, in a composition with the video.");
        return;
    }
    if (comp.width !== width || comp.height !== height) {
        alert("The composition must have the video's size, " + width + " x " + height + ".");
        return;
    }
    var layer = comp.selectedLayers[0];
    app.beginUndoGroup("Corner Pin by ar-replace");
    layer.parent = null;
    layer.threeDLayer = false;
    var place = layer.property("ADBE Transform Group");
    place.property("ADBE Position").dimensionsSeparated = false;
    still(place.property("ADBE Anchor Point"), [0, 0]);
    still(place.property("ADBE Position"), [0, 0]);
    still(place.property("ADBE Scale"), [100, 100]);
    still(place.property("ADBE Rotate Z"), 0);
    var pin = layer.property("ADBE Effect Parade").addProperty("ADBE Corner Pin");
    for (var name in corners) {
        if (!corners.hasOwnProperty(name)) { continue; }
        var property = pin.property(name);
        property.setValuesAtTimes(times, corners[name]);
        for (var i = 0; i < holds.length; i++) {
            property.setInterpolationTypeAtKey(holds[i], KeyframeInterpolationType.HOLD);
        }
    }
    app.endUndoGroup();
}());
"""


def corner_pin_script(keys: Keys) -> str:
    """A script that sets the effect Corner Pin, with its keys, on the selected layer."""
    points = from_top_left(keys.corners)
    start = keys.first_frame / keys.track.source.fps
    values = {name: ", ".join(f"[{number(x)}, {number(y)}]" for x, y in points[:, p]) for name, p in CORNER_PIN.items()}
    filled = SCRIPT % {
        "width": keys.size[0],
        "height": keys.size[1],
        "times": ", ".join(number(float(time + start), 6) for time in keys.times),
        "holds": ", ".join(str(n) for n, index in enumerate(keys.indices[1:], 1) if index in keys.track.cuts),
        "corners": ",\n".join(f"        {json.dumps(name)}: [{points}]" for name, points in values.items()),
    }
    return "".join(f"// {note}\n" for note in keys.notes) + filled
