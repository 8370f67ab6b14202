"use strict";
// Shows the numbers of one point in time: where the pointer is, or where the slider was moved to.
for (const plots of document.querySelectorAll(".plots")) {
  const data = JSON.parse(plots.querySelector("script").textContent);
  const slider = plots.parentNode.querySelector("input");
  const told = plots.parentNode.querySelector("output");
  const values = [...plots.querySelectorAll(".value")];
  const ranges = values.map((value) => value.textContent);
  const place = plots.querySelector("svg.line");
  const cursor = plots.appendChild(document.createElement("div"));
  cursor.className = "cursor";
  cursor.hidden = true;
  const show = (point) => {
    const box = place.getBoundingClientRect();
    const left = box.left - plots.getBoundingClientRect().left;
    cursor.style.left = `${left + ((point + 0.5) / data.frames.length) * box.width}px`;
    cursor.hidden = false;
    slider.value = point;
    slider.setAttribute("aria-valuetext", data.frames[point]);
    told.textContent = data.frames[point];
    data.values.forEach((of, i) => {
      values[i].textContent = of[point] === null ? "–" : `${of[point].toFixed(data.digits[i])} ${data.units[i]}`;
    });
  };
  const rest = () => {
    cursor.hidden = true;
    told.textContent = "";
    values.forEach((value, i) => (value.textContent = ranges[i]));
  };
  plots.addEventListener("pointermove", (event) => {
    const box = place.getBoundingClientRect();
    const share = (event.clientX - box.left) / box.width;
    if (share >= 0 && share < 1) show(Math.floor(share * data.frames.length));
  });
  plots.addEventListener("pointerleave", rest);
  slider.addEventListener("input", () => show(Number(slider.value)));
  slider.addEventListener("focus", () => show(Number(slider.value)));
  slider.addEventListener("blur", rest);
}
