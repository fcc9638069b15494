/** A series, drawn; of several mass spectra the one that is asked for. */

import { useState } from "react";
import type { Drawn } from "@/model/wirefiles";
import { Loaded } from "./card";
import { Button, TextField } from "./controls";
import { SeriesPlot } from "./seriesplot";

export function Curve(props: {
  source: Parameters<typeof Loaded<Drawn>>[0]["source"];
  height: number;
  onScan: (scan: number) => void;
}) {
  return (
    <div className="pb">
      <Loaded source={props.source} what="the series">
        {(points) => (
          <>
            <SeriesPlot drawn={points} height={props.height} />
            {points.scan && (
              <ScanField
                least={Number(points.scan.least)}
                most={Number(points.scan.most)}
                value={points.scan.value}
                onChange={props.onScan}
              />
            )}
            {points.is_thinned && (
              <p className="help">Each stretch shows its least and its largest value.</p>
            )}
          </>
        )}
      </Loaded>
    </div>
  );
}

function ScanField(props: {
  least: number;
  most: number;
  value: number;
  onChange: (scan: number) => void;
}) {
  const [text, setText] = useState(String(props.value));
  const number = /^\d{1,9}$/.test(text) ? Number(text) : null;
  const isFit = number !== null && number >= props.least && number <= props.most;
  return (
    <form
      className="scanfield"
      onSubmit={(event) => {
        event.preventDefault();
        if (isFit && number !== null) props.onChange(number);
      }}
    >
      <TextField
        label={`Spectrum ${props.least} to ${props.most}`}
        value={text}
        onChange={setText}
        error={isFit ? null : `A whole number from ${props.least} to ${props.most}.`}
        testId="scan"
      />
      <Button type="submit" disabled={!isFit}>
        Draw
      </Button>
    </form>
  );
}
