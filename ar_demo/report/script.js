"use strict";
// Shows the numbers of one point in time: where the pointer is, or where the slider was moved to.
for (const plots of document.querySelectorAll(".plots")) {
  const data = JSON.parse(plots.querySelector("script").textContent);
  const slider = plots.parentNode.querySelector("input");
  const told = plots.parentNode.querySelector("output");
  const values = plots.querySelectorAll(".value");
  const place = plots.querySelector(".row > svg.line");
  const cursor = plots.appendChild(document.createElement("div"));
  cursor.className = "cursor";
  cursor.hidden = true;
  const show = (point) => {
    const box = place.getBoundingClientRect();
    cursor.style.left = box.left - plots.getBoundingClientRect().left + ((point + 0.5) / data.frames.length) * box.width + "px";
    cursor.hidden = false;
    slider.value = point;
    slider.setAttribute("aria-valuetext", data.frames[point]);
    told.textContent = data.frames[point];
    data.values.forEach((of, i) => {
      values[i].textContent = of[point] === null ? "–" : of[point].toFixed(data.digits[i]) + " " + data.units[i];
    });
  };
  plots.addEventListener("pointermove", (event) => {
    const box = place.getBoundingClientRect();
    const share = (event.clientX - box.left) / box.width;
    if (share >= 0 && share < 1) show(Math.floor(share * data.frames.length));
  });
  slider.addEventListener("input", () => show(Number(slider.value)));
}
