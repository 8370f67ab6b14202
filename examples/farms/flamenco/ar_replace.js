// A job type of Flamenco: track once, then render pictures in chunks. It goes into the manager's folder `scripts`.

const JOB_TYPE = {
    label: "ar-replace",
    description: "Put an ad on a planar surface of a video",
    settings: [
        { key: "video", type: "string", required: true, description: "The video" },
        { key: "ad", type: "string", required: true, description: "Video or picture that is put on the surface" },
        { key: "quad", type: "string", required: true, description: "Corners in the first frame: x,y x,y x,y x,y" },
        { key: "frames", type: "string", required: true, description: "First and last frame, as 0-299" },
        { key: "chunk_size", type: "int32", default: 100, description: "Frames that one task renders" },
        { key: "output", type: "string", required: true, description: "Pictures to write, as /shots/out.%05d.png" },
    ],
};

function compileJob(job) {
    const settings = job.settings;
    const track = `${settings.output}.track.json`;

    const tracking = author.Task("track", "misc");
    tracking.addCommand(author.Command("exec", {
        exe: "ar-track",
        args: [settings.video, "--quad", settings.quad, "-o", track, "--overwrite"],
    }));
    job.addTask(tracking);

    for (const chunk of frameChunker(settings.frames, settings.chunk_size)) {
        const task = author.Task(`render-${chunk}`, "misc");
        task.addCommand(author.Command("exec", {
            exe: "ar-replace",
            args: [
                settings.video, settings.ad, "--track", track,
                "--frames", chunk, "-o", settings.output, "--overwrite",
            ],
        }));
        task.addDependency(tracking);
        job.addTask(task);
    }
}
