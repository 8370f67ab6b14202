// As much of After Effects' object model as a corner pin needs. Prints what a script did to the first layer.
var KeyframeInterpolationType = { LINEAR: 6612, HOLD: 6614 };
var told = [];
function alert(text) { told.push(text); }

function Property(value) { this.value = value; this.keys = []; this.holds = []; this.expression = ""; }
Object.defineProperty(Property.prototype, "numKeys", { get: function () { return this.keys.length; } });
Property.prototype.removeKey = function (index) { this.keys.splice(index - 1, 1); };
Property.prototype.setValue = function (value) {
    if (this.keys.length) { throw new Error("setValue on a property with keys"); }
    this.value = value;
};
Property.prototype.setValuesAtTimes = function (times, values) {
    if (times.length !== values.length) { throw new Error("times and values differ in number"); }
    for (var i = 0; i < times.length; i++) { this.keys.push([times[i], values[i]]); }
};
Property.prototype.setInterpolationTypeAtKey = function (index, type) {
    if (index < 1 || index > this.keys.length) { throw new Error("no such key"); }
    if (type === KeyframeInterpolationType.HOLD) { this.holds.push(index); }
};

function Group(properties) { this.properties = properties; }
Group.prototype.property = function (name) {
    if (!(name in this.properties)) { throw new Error("no property " + name); }
    return this.properties[name];
};

function Layer() {
    var moved = new Property([640, 360]);
    moved.keys = [[0, [1, 2]], [1, [3, 4]]];
    this.parent = {};
    this.threeDLayer = true;
    this.transform = {
        "ADBE Anchor Point": new Property([50, 50]), "ADBE Position": moved,
        "ADBE Scale": new Property([50, 50]), "ADBE Rotate Z": new Property(90)
    };
    this.pin = {};
    for (var i = 1; i <= 4; i++) { this.pin["ADBE Corner Pin-000" + i] = new Property([0, 0]); }
    var pin = this.pin, effects = new Group({});
    effects.addProperty = function (name) {
        if (name !== "ADBE Corner Pin") { throw new Error("no effect " + name); }
        return new Group(pin);
    };
    this.groups = new Group({ "ADBE Transform Group": new Group(this.transform), "ADBE Effect Parade": effects });
}
Layer.prototype.property = function (name) { return this.groups.property(name); };

function CompItem() { this.width = WIDTH; this.height = HEIGHT; this.selectedLayers = []; }
var comp = new CompItem(), layer = new Layer(), undo = 0;
for (var n = 0; n < LAYERS; n++) { comp.selectedLayers.push(layer); }
var app = {
    project: { activeItem: comp },
    beginUndoGroup: function () { undo += 1; }, endUndoGroup: function () { undo -= 1; }
};

SCRIPT

var keys = {}, place = {}, holds = {};
for (var name in layer.pin) { keys[name] = layer.pin[name].keys; holds[name] = layer.pin[name].holds; }
for (name in layer.transform) { place[name] = layer.transform[name].value; }
console.log(JSON.stringify({ keys: keys, place: place, holds: holds, told: told, undo: undo, parent: layer.parent }));
